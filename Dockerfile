# docker build -t steer-by-wire . && docker run --rm steer-by-wire run --duration 20
# vcan0 in a container without privileges: docker run --rm steer-by-wire with-vcan ip link show vcan0
# The release names the base by its digest; the image's label org.opencontainers.image.base.name has it.
ARG BASE=python:3.12-slim-bookworm
FROM $BASE
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends \
        can-utils gcc iproute2 kmod libc6-dev user-mode-linux \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /opt/steer-by-wire
COPY . .
# The tested versions, each by its digest.
RUN pip install --quiet --no-cache-dir --require-hashes -r requirements.lock \
    && pip install --quiet --no-cache-dir --no-deps --no-build-isolation .
# Not root; --user "$(id -u)" writes into a folder of yours. Its home would be /: nothing is kept there.
ENV HOME=/tmp
WORKDIR /work
RUN chown 10001 /work
USER 10001
ENTRYPOINT ["steer-by-wire"]
CMD ["--help"]
