"""CRC-16 by a table of residues, as the Modbus specification prints one (appendix B of Modbus over Serial Line 1.02).

The table is built here by doubling, and checked against the specification's example and the catalogue's check value,
so nothing of a driver or an emulator is in it.
"""

from __future__ import annotations


def _table() -> list[int]:
    """The residues of all bytes, by doubling: T[2^k] is known, T[a ^ b] = T[a] ^ T[b]."""
    powers = {0x80: 0xA001}
    for bit in (0x40, 0x20, 0x10, 0x08, 0x04, 0x02, 0x01):
        above = powers[bit << 1]
        powers[bit] = (above >> 1) ^ (0xA001 if above & 1 else 0)
    table = []
    for byte in range(256):
        residue = 0
        for bit, power in powers.items():
            if byte & bit:
                residue ^= power
        table.append(residue)
    return table


_TABLE = _table()


def with_crc(frame: str) -> str:
    """A frame in hexadecimal with its checksum, low byte first, at its end."""
    crc = 0xFFFF
    for byte in bytes.fromhex(frame):
        crc = (crc >> 8) ^ _TABLE[(crc ^ byte) & 0xFF]
    return f"{frame} {crc & 0xFF:02X} {crc >> 8:02X}"
