"""The key of authenticated frames: from a file that only its owner can read, and never shown.

The file contains 32 hexadecimal digits (AES-128) on one line. It must be a regular file, not a
symbolic link, owned by this user or root, that no one else may read or write; so no one else can
have put it there either. Otherwise it is refused with a one-line error that never shows any of its
content.

The key is kept only inside a started CMAC of ``cryptography``, from which it cannot be read. No
object of ours holds it, so that no report, dump of settings or traceback can show it.
"""

import errno
import os
import stat
import time
from collections.abc import Callable, Collection
from pathlib import Path

from ...runtime.command_line import installation
from ...runtime.node import NS_PER_US
from ...runtime.settings import SettingsError
from .authentication import Authentication, ComputeMac
from .secured_frame import CHALLENGE_LENGTH

KEY_LENGTH = 16
"""AES-128 [bytes]."""
_DIGITS = 2 * KEY_LENGTH
_READ_MAX = 4 * _DIGITS
"""Enough to detect that a file is too long [bytes]."""
_OTHERS = stat.S_IRWXG | stat.S_IRWXO


def open_authentication(path: Path, peers: Collection[str]) -> Authentication:
    """Start one end, of these peers, with the key in ``path``; raises SettingsError.

    Its challenge comes from the operating system's random generator. On a bus it must not come from
    a seed: an attacker who knew it could have recorded the answers before.
    """
    compute_mac = read_key(path)
    challenge = os.urandom(CHALLENGE_LENGTH)
    first_counter = time.time_ns() // NS_PER_US  # see rule 3 of ``dbc.secoc.authentication``
    return Authentication(peers, compute_mac, challenge, first_counter)


def read_key(path: Path) -> ComputeMac:
    """Return the CMAC under the key in ``path``; raises SettingsError."""
    if not hasattr(os, "geteuid"):
        raise SettingsError(f"{path}: this platform does not report who may read a key file")
    make_cmac = cmac_maker()  # can fail, so it comes before the key is in a local variable
    key = _parsed(_read_private(path))
    if key is None:  # raised here, where no variable holds the text any more
        raise SettingsError(f"{path}: a key is {_DIGITS} hexadecimal digits on one line")
    return make_cmac(key)


def cmac_maker() -> Callable[[bytes], ComputeMac]:
    """Return a function from key to CMAC; raises SettingsError without ``cryptography``."""
    try:
        from cryptography.hazmat.primitives.ciphers.algorithms import AES128
        from cryptography.hazmat.primitives.cmac import CMAC
    except ImportError as error:
        raise SettingsError(
            f"authentication needs cryptography: {installation('cryptography')}"
        ) from error

    def make_cmac(key: bytes) -> ComputeMac:
        keyed = CMAC(AES128(key))  # copying it takes a third of the time of making a new one

        def compute_mac(text: bytes) -> bytes:
            context = keyed.copy()
            context.update(text)
            return context.finalize()

        return compute_mac

    return make_cmac


def _read_private(path: Path) -> bytes:
    """Return the content of ``path`` up to _READ_MAX; raises SettingsError if it is not private.

    The check is made on the open file, so that it cannot be replaced in between.
    """
    try:
        # Without waiting: a named pipe without a writer would never open.
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError as error:
        if _parsed(os.fsencode(path)) is not None:
            raise SettingsError("--key-file takes the name of a file, and this is a key") from None
        cause = "is a symbolic link" if error.errno == errno.ELOOP else error.strerror
        raise SettingsError(f"{path}: cannot be used as a key file: {cause}") from None
    try:
        found = os.fstat(descriptor)
        obstacle = _obstacle(found, os.geteuid())
        if obstacle:
            raise SettingsError(f"{path}: cannot be used as a key file: {obstacle}")
        return os.read(descriptor, _READ_MAX)
    finally:
        os.close(descriptor)


def _obstacle(found: os.stat_result, user: int) -> str:
    """Why a file is not safe for a key of ``user``; empty if it is safe."""
    if not stat.S_ISREG(found.st_mode):
        return "is not a regular file"
    if found.st_uid not in (0, user):
        return f"belongs to user {found.st_uid}, not to you ({user}) or root"
    if found.st_mode & _OTHERS:
        return f"others may use it (mode {stat.S_IMODE(found.st_mode):04o}): chmod 600 it"
    return ""


def _parsed(text: bytes) -> bytes | None:
    digits = text.removesuffix(b"\n").removesuffix(b"\r")
    if len(digits) != _DIGITS:
        return None
    try:
        key = bytes.fromhex(digits.decode("ascii"))
    except ValueError:
        return None
    return key if len(key) == KEY_LENGTH else None
