"""Folders of each package; ``pyproject.toml`` has the rest.

The folders of the top level are packages of ``steer_by_wire``, and so is with-vcan, which is also a
distribution of its own. Inside the checkout symbolic links say so; an installation goes by this,
and is whole where git has made no links.

With SOURCE_DATE_EPOCH, wheel and source are the same bytes whenever they are built.
"""

import gzip
import os
import tarfile
import time
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.sdist import sdist

FOLDERS = ("closed_loop", "controller", "dbc", "hand_wheel", "plant_emulator", "runtime", "tools")
PACKAGES = find_packages(include=[name for folder in FOLDERS for name in (folder, f"{folder}.*")])
WITH_VCAN = "steer_by_wire.with_vcan"


class Source(sdist):
    """The source archive, with one time and owner for all files, in alphabetical order."""

    def make_archive(self, base_name, _format, root_dir=None, base_dir=None, **_owner):
        """Write the archive; returns its name."""
        time_s = int(os.environ.get("SOURCE_DATE_EPOCH", time.time()))

        def fixed(file):
            file.mtime, file.uid, file.gid, file.uname, file.gname = time_s, 0, 0, "", ""
            file.mode = 0o755 if file.mode & 0o100 else 0o644
            return file

        name = f"{base_name}.tar.gz"
        self.mkpath(os.path.dirname(name))
        with (
            open(name, "wb") as raw,
            gzip.GzipFile("", "wb", fileobj=raw, mtime=time_s) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive,
        ):
            folder = Path(root_dir or ".", base_dir)
            for file in sorted(folder.rglob("*")):
                place = Path(base_dir, file.relative_to(folder))
                archive.add(file, place, recursive=False, filter=fixed)
        return name


setup(
    cmdclass={"sdist": Source},
    packages=["steer_by_wire", WITH_VCAN, *(f"steer_by_wire.{package}" for package in PACKAGES)],
    package_dir={f"steer_by_wire.{folder}": folder for folder in FOLDERS}
    | {WITH_VCAN: "packaging/with_vcan/with_vcan"},
)
