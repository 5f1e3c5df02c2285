#!/usr/bin/env python3
"""Prints which libraries the extension module of each wheel for macOS needs, and fails where one is not the system's.

    .ci/wheel_needs.py WHEEL...
"""
import re
import sys
import zipfile

import lief

SYSTEM = re.compile(r'/usr/lib/lib[\w+-]+(\.\w+)?\.dylib|/System/Library/Frameworks/\w+\.framework/.*')


def needs(wheel):
    """Returns the names of the libraries that the wheel's only extension module loads."""
    with zipfile.ZipFile(wheel) as archive:
        [module] = [name for name in archive.namelist() if name.endswith('.so')]
        fat = lief.MachO.parse(list(archive.read(module)))
    loads = lief.MachO.LoadCommand.TYPE.LOAD_DYLIB
    return sorted({library.name for binary in fat for library in binary.libraries if library.command == loads})


def main():
    failed = False
    for wheel in sys.argv[1:]:
        names = needs(wheel)
        print(f'{wheel}: needs {", ".join(names)}')
        others = [name for name in names if not SYSTEM.fullmatch(name)]
        if others or not names:
            print(f'{wheel}: not of the system: {", ".join(others) or "no library is named"}', file=sys.stderr)
            failed = True
    sys.exit(failed)


if __name__ == '__main__':
    main()
