"""Checks that packages which several lock files hold have the same versions in all.

    check_locks.py Cargo.lock...
"""

import sys
import tomllib


def versions(path: str) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    with open(path, "rb") as file:
        for package in tomllib.load(file)["package"]:
            found.setdefault(package["name"], set()).add(package["version"])
    return found


first, *others = sys.argv[1:]
held = versions(first)
wrong = [
    f"{path}: {name} {', '.join(sorted(found - held[name]))}, {first} has {', '.join(sorted(held[name]))}"
    for path in others
    for name, found in versions(path).items()
    if name in held and not found <= held[name]
]
sys.exit("\n".join(wrong) or 0)
