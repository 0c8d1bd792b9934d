# SPDX-License-Identifier: GPL-3.0-or-later
"""What a compiled library is made for and which others it loads, from its headers: ELF, PE and Mach-O of 64 bits."""
from __future__ import annotations

import struct
from dataclasses import dataclass

ELF_MACHINES = {62: "x86_64", 183: "aarch64"}
PE_MACHINES = {0x8664: "amd64", 0xAA64: "arm64"}
MACH_MACHINES = {0x01000007: "x86_64", 0x0100000C: "arm64"}
LOAD_DYLIB = {0xC, 0x8000001F}  # and re-exported ones; weak ones may be missing


@dataclass(frozen=True)
class Binary:
    system: str                # "linux", "win" or "macosx"
    machines: tuple[str, ...]  # several in a universal Mach-O file
    needs: tuple[str, ...]     # names or paths of libraries, as they are written there


def read_binary(data: bytes) -> Binary | None:
    """None for what is no such file. Raises struct.error or ValueError for one that is cut off."""
    if data[:4] == b"\x7fELF" and data[4] == 2:
        return _read_elf(data)
    if data[:2] == b"MZ":
        return _read_pe(data)
    if data[:4] == b"\xcf\xfa\xed\xfe":
        return _read_mach(data)
    if data[:4] == b"\xca\xfe\xba\xbe" and struct.unpack_from(">I", data, 4)[0] < 20:  # else a Java class
        count, = struct.unpack_from(">I", data, 4)
        places = (struct.unpack_from(">5I", data, 8 + 20 * i)[2:4] for i in range(count))
        parts = [_read_mach(data[start:start + size]) for start, size in places]
        return Binary("macosx", tuple(part.machines[0] for part in parts), parts[0].needs)
    return None


def _read_text(data: bytes, at: int) -> str:
    return data[at:data.index(b"\0", at)].decode()


def _read_elf(data: bytes) -> Binary:
    machine, = struct.unpack_from("<H", data, 18)
    table, = struct.unpack_from("<Q", data, 32)
    size, count = struct.unpack_from("<2H", data, 54)
    headers = [struct.unpack_from("<2I6Q", data, table + i * size) for i in range(count)]
    loaded = [(address, length, offset) for kind, _, offset, address, _, length, *_ in headers if kind == 1]

    def to_offset(address: int) -> int:
        return next(offset + address - start for start, length, offset in loaded if start <= address < start + length)

    entries = []
    for kind, _, offset, _, _, length, *_ in headers:
        if kind == 2:  # the dynamic section
            entries = list(struct.iter_unpack("<2Q", data[offset:offset + length]))
    names = next((to_offset(value) for tag, value in entries if tag == 5), 0)
    return Binary("linux", (ELF_MACHINES.get(machine, str(machine)),),
                  tuple(_read_text(data, names + value) for tag, value in entries if tag == 1))


def _read_pe(data: bytes) -> Binary:
    start, = struct.unpack_from("<I", data, 0x3C)
    machine, sections = struct.unpack_from("<2H", data, start + 4)
    optional, = struct.unpack_from("<H", data, start + 20)
    if struct.unpack_from("<H", data, start + 24)[0] != 0x20B:
        return Binary("win", (PE_MACHINES.get(machine, str(machine)),), ())
    tables = [struct.unpack_from("<4I", data, start + 24 + optional + 40 * i + 8) for i in range(sections)]

    def to_offset(address: int) -> int:
        return next(raw + address - virtual for size, virtual, raw_size, raw in tables
                    if virtual <= address < virtual + max(size, raw_size))

    needs, (imports,) = [], struct.unpack_from("<I", data, start + 24 + 120)
    offset = imports and to_offset(imports)  # libraries that are loaded at the first call only stand elsewhere
    while offset and (name := struct.unpack_from("<I", data, offset + 12)[0]):
        needs.append(_read_text(data, to_offset(name)))
        offset += 20
    return Binary("win", (PE_MACHINES.get(machine, str(machine)),), tuple(needs))


def _read_mach(data: bytes) -> Binary:
    machine, = struct.unpack_from("<I", data, 4)
    count, = struct.unpack_from("<I", data, 16)
    offset, needs = 32, []
    for _ in range(count):
        command, size = struct.unpack_from("<2I", data, offset)
        if command in LOAD_DYLIB:
            needs.append(_read_text(data, offset + struct.unpack_from("<I", data, offset + 8)[0]))
        offset += size
    return Binary("macosx", (MACH_MACHINES.get(machine, str(machine)),), tuple(needs))
