#!/usr/bin/env python3
"""Writes an MBTiles file with a field of four colours about a place: `make_map.py FILE LATITUDE LONGITUDE`."""

import math
import pathlib
import sqlite3
import struct
import sys
import zlib

ZOOM = 21
AROUND = 4
# By the parity of column and row, counted from the north.
COLOURS = {(0, 0): (64, 144, 48), (1, 0): (208, 184, 112), (0, 1): (144, 64, 32), (1, 1): (48, 96, 160)}


def tile_of(latitude_deg, longitude_deg):
    """Returns column and row of a place, with fractions."""
    tiles = 2 ** ZOOM
    north = math.log(math.tan(math.pi / 4 + math.radians(latitude_deg) / 2))
    return (longitude_deg + 180) / 360 * tiles, (0.5 - north / (2 * math.pi)) * tiles


def png(colour, side=256):
    """Returns a picture of one colour, ruled every eighth of it."""
    ruled = bytes(value - 16 for value in colour) * side
    plain = (bytes(value - 16 for value in colour) + bytes(colour) * 31) * (side // 32)
    lines = b"".join(b"\0" + (plain if y % 32 else ruled) for y in range(side))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")


def main(file, latitude_deg, longitude_deg):
    pathlib.Path(file).unlink(missing_ok=True)
    database = sqlite3.connect(file)
    database.execute("CREATE TABLE metadata(name TEXT, value TEXT)")
    database.execute("CREATE TABLE tiles(zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB)")
    # What a page must not run.
    attribution = "&copy; <a href=https://example.org>Field Survey</a><img src=x onerror=\"document.title = 'run'\">"
    about = {"name": "Field", "format": "png", "attribution": attribution}
    database.executemany("INSERT INTO metadata VALUES (?, ?)", about.items())
    column, row = (math.floor(at) for at in tile_of(latitude_deg, longitude_deg))
    for x in range(column - AROUND, column + AROUND + 1):
        for y in range(row - AROUND, row + AROUND + 1):
            tile = (ZOOM, x, 2 ** ZOOM - 1 - y, png(COLOURS[x % 2, y % 2]))
            database.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", tile)
    database.commit()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), float(sys.argv[3]))
