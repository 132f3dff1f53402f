"""Address of a broker: a Unix socket that only its user can open, or TCP on the loopback.

The default is a Unix socket in a private directory of the user. At any other path it is private to
its user too. A directory in which others could replace the socket is refused. TCP is for machines
without Unix sockets: every local user can join the bus, but no one from outside.
"""

import ipaddress
import os
import socket
import stat
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from ..exit_status import ExitStatus, UserError

_DEFAULT_TCP_PORT = 29580
_PORT_DIGITS_MAX = 20
"""Longer texts are paths; Python does not convert thousands of digits."""
_BACKLOG = 32


class AddressError(UserError):
    """An address that is invalid, in use, or not safe to use."""

    exit_status = ExitStatus.BUS


class TcpAddress(NamedTuple):
    """A port of the loopback; port 0 takes a free one."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


Address = Path | TcpAddress
"""A socket in the file system, or a port."""


def parse_address(text: str) -> Address:
    """Read ``PATH`` or ``HOST:PORT``; raises AddressError for a host that is not the loopback."""
    host, colon, port = text.rpartition(":")
    if text and (not colon or "/" in text or len(port) > _PORT_DIGITS_MAX):
        if not hasattr(socket, "AF_UNIX"):
            raise AddressError(f"no Unix sockets here, give 127.0.0.1:PORT instead of {text!r}")
        return Path(text)
    host = "127.0.0.1" if host == "localhost" else host
    try:
        is_loopback = ipaddress.IPv4Address(host).is_loopback
    except ValueError:
        is_loopback = False
    if not (is_loopback and port.isdecimal() and int(port) <= 65535):
        raise AddressError(f"an address is PATH or 127.0.0.1:PORT, not {text!r}")
    return TcpAddress(host, int(port))


def default_address() -> Address:
    """Return this user's own address; raises AddressError when others can write there."""
    if not hasattr(socket, "AF_UNIX"):
        return TcpAddress("127.0.0.1", _DEFAULT_TCP_PORT)
    runtime_directory = os.environ.get("XDG_RUNTIME_DIR")
    if runtime_directory:
        directory = Path(runtime_directory) / "emulated-can-bus"
    else:
        directory = Path(tempfile.gettempdir()) / f"emulated-can-bus-{os.getuid()}"
    if directory.exists():
        _check_private(directory)
    return directory / "socket"


def connect(address: Address, timeout_s: float) -> socket.socket:
    """Connect to a broker; raises OSError when none listens."""
    connection = socket.socket(_family_of(address), socket.SOCK_STREAM)
    try:
        connection.settimeout(timeout_s)
        if isinstance(address, TcpAddress):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.connect(_bindable(address))
    except OSError:
        connection.close()
        raise
    return connection


@contextmanager
def listening(address: Address) -> Iterator[socket.socket]:
    """Listen at ``address`` until the end of the block.

    Raises AddressError when another broker listens there or the address cannot be used. The
    socket of a killed broker is replaced.
    """
    with ExitStack() as stack:
        try:
            if isinstance(address, Path):
                stack.enter_context(_locked(address))
                _check_closed(address.parent)
                _remove_abandoned(address)
            listener = stack.enter_context(socket.socket(_family_of(address), socket.SOCK_STREAM))
            _listen(listener, address)
            if isinstance(address, Path):
                stack.callback(address.unlink, missing_ok=True)
        except OSError as error:
            raise AddressError(f"cannot listen at {address}: {error.strerror or error}") from error
        yield listener


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock of the socket at ``path``.

    The kernel releases it however the process ends, so its holder may remove a socket at ``path``.
    A test by connecting would let two brokers that start together remove each other's new socket.
    The lock's file stays, because removing it would have the same race.
    """
    import fcntl  # does not exist where there are no Unix sockets

    if path == default_address():
        path.parent.mkdir(mode=0o700, exist_ok=True)
        _check_private(path.parent)
    lock = os.open(f"{path}.lock", os.O_CREAT | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise AddressError(f"an emulated bus is already listening at {path}") from None
        yield
    finally:
        os.close(lock)


def _remove_abandoned(path: Path) -> None:
    with suppress(FileNotFoundError):
        if not stat.S_ISSOCK(path.lstat().st_mode):
            raise AddressError(f"{path} exists and is not a socket")
        path.unlink()


def _listen(listener: socket.socket, address: Address) -> None:
    if isinstance(address, TcpAddress):
        # Otherwise connections of an ended broker block the port for a minute.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    # The mode has to be right from the start: between bind and chmod others could connect.
    umask = os.umask(0o177)
    try:
        listener.bind(_bindable(address))
    finally:
        os.umask(umask)
    listener.listen(_BACKLOG)


def _family_of(address: Address) -> socket.AddressFamily:
    return socket.AF_INET if isinstance(address, TcpAddress) else socket.AF_UNIX


def _bindable(address: Address) -> str | TcpAddress:
    return address if isinstance(address, TcpAddress) else str(address)


def _check_private(directory: Path) -> None:
    """Raise AddressError unless ``directory`` is this user's own and closed to all others."""
    status = directory.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise AddressError(f"{directory} is not a directory of mode 0700 that belongs to you")


def _check_closed(directory: Path) -> None:
    """Raise AddressError if any user could replace the socket."""
    mode = directory.stat().st_mode
    if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
        raise AddressError(
            f"every user may write to {directory} and so replace the socket: chmod o-w {directory}"
        )
