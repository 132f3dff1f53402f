"""Records in JSON that notice their damage: one entry is the CRC-32 of all others.

A flipped bit in a number is a number too. A record without the entry, as earlier releases wrote
it, is taken as it is.
"""

import json
import zlib
from collections.abc import Mapping
from typing import Any

_SEAL = "crc32"


def sealed(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record with its checksum."""
    return {**record, _SEAL: _crc(record)}


def unsealed(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record without its checksum; raises ValueError for a damaged one."""
    content = dict(record)
    crc = content.pop(_SEAL, None)
    if crc is not None and crc != _crc(content):
        raise ValueError("damaged: it is not what was written")
    return content


def _crc(record: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(record).encode())
