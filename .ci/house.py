#!/usr/bin/env python3
"""Counts how large the house is: code, settings, crates, documentation, names and profiles.

    .ci/house.py [CHECKOUT]

It reads the files of a checkout and asks cargo for its crates. It judges nothing.
"""
import re
import subprocess
import sys
from pathlib import Path

from import_circles import strip

WITHOUT = {'target', '.git'}
# Made from the code, and for who changes it.
NOT_FOR_USERS = {'configuration.md', 'architecture.md', 'contributing.md'}
DECLARATION = re.compile(r'^(?:pub(?:\([^)]*\))?\s+)?(?:struct|enum|type)\s+(\w+)', re.M)
ROWS = re.compile(r'<!-- keys: \S+ (\S+).*?-->\n+((?:\|.*\n)+)')


def files(root, pattern):
    return [file for file in sorted(root.rglob(pattern)) if not WITHOUT & set(file.relative_to(root).parts)]


def is_test(file):
    parts = file.with_suffix('').parts
    return 'tests' in parts or parts[-1].startswith('test_') or parts[-1].endswith('_tests')


def code(root):
    """The text of each Rust file that is not a test, without its unit tests."""
    return {file: file.read_text() for file in files(root, '*.rs') if not is_test(file.relative_to(root))}


def without_unit_tests(text):
    """The text up to its module of tests, which stands last."""
    return re.split(r'^#\[cfg\(test\)\]\n(?:#.*\n)*mod \w+ \{', text, maxsplit=1, flags=re.M)[0]


def type_names(sources):
    """The names by which more than one file declares a type; the classes of the Python module have those of Rust."""
    found = {}
    for file, text in sources.items():
        if 'python' in file.parts:
            continue
        for name in DECLARATION.findall(strip(text)):
            found.setdefault(name, set()).add(file)
    return sorted(name for name, places in found.items() if len(places) > 1)


def settings(root):
    """The keys of docs/configuration.md that hold a value, and all its keys under `controller`."""
    every = controller = 0
    for section, table in ROWS.findall((root / 'docs/configuration.md').read_text()):
        keys = [row for row in table.splitlines() if row.startswith('| `')]
        every += sum('| section |' not in row for row in keys)
        controller += len(keys) if section.split('.')[0] == 'controller' else 0
    return every, controller


def crates(root):
    """The packages that `cargo build --release` compiles."""
    command = ['cargo', 'tree', '--locked', '--edges', 'normal,build', '--prefix', 'none', '--format', '{p}']
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    return len({line.removesuffix(' (*)') for line in done.stdout.splitlines() if line})


def words(root):
    pages = [page for page in files(root / 'docs', '*.md') if page.name not in NOT_FOR_USERS]
    return sum(len(page.read_text().split()) for page in pages)


def profile_lines(root):
    sections = re.findall(r'^\[profile[^\n]*\n(?:(?!\[)[^\n]*\n)*', (root / 'Cargo.toml').read_text(), re.M)
    return sum(bool(line.strip()) and not line.startswith('#') for text in sections for line in text.splitlines())


def main():
    root = Path(sys.argv[1] if len(sys.argv) > 1 else '.').resolve()
    sources = code(root)
    names = type_names(sources)
    every, controller = settings(root)
    for what, count in [
        ('lines of Rust that are not tests', sum(without_unit_tests(text).count('\n') for text in sources.values())),
        ('configuration values', every),
        ('configuration rows under `controller`', controller),
        ('crates compiled by the first command', crates(root)),
        ('words of docs that a user reads', words(root)),
        ('type names of two types or more', len(names)),
        ('profile lines in Cargo.toml', profile_lines(root)),
    ]:
        print(f'{what:40}{count:8}')
    print('type names of two types or more:', ', '.join(names))


if __name__ == "__main__":
    main()
