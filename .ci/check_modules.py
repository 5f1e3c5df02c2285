#!/usr/bin/env python3
"""Fails where source files of a crate import each other in a circle.

    .ci/check_modules.py [CRATE_FOLDER]...

An import is a `use` or a path to an item of the same crate; it counts for the file that defines the
item, through re-exports. `mod` declarations, re-exports and tests do not count.
"""

import pathlib
import re
import sys

ITEM = re.compile(
    r"\b(?:struct|enum|union|trait|fn|const|static|type|macro_rules!|mod)\s+(?:mut\s+)?(\w+)"
)
USE = re.compile(r"(?:^|(?<=[;{}\n]))\s*(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);")
PATH = re.compile(r"(?<![\w:])((?:crate|self|super|[a-z]\w*)(?:::\w+)+)")


def strip(text):
    """The text without comments, strings and what is compiled for tests alone."""
    text = re.sub(r"//[^\n]*", "", text)
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    text = re.sub(r'r?#*"(?:\\.|[^"\\])*"#*', '""', text, flags=re.S)
    while (found := re.search(r"#\[cfg\(test\)\]", text)) is not None:
        end = text.find(";", found.end())
        brace = text.find("{", found.end())
        if brace != -1 and (end == -1 or brace < end):
            depth, end = 1, brace + 1
            while depth and end < len(text):
                depth += {"{": 1, "}": -1}.get(text[end], 0)
                end += 1
            end -= 1
        text = text[: found.start()] + (text[end + 1 :] if end != -1 else "")
    return text


def leaves(tree, prefix=()):
    """The paths of a use tree with the names they get: (path, name)."""
    tree = tree.strip()
    brace = tree.find("{")
    if brace == -1:
        path, _, name = tree.partition(" as ")
        path = prefix + tuple(part.strip() for part in path.split("::"))
        if path[-1] == "self":
            path = path[:-1]
        yield path, (name.strip() or path[-1])
        return
    head = tuple(part.strip() for part in tree[:brace].split("::") if part.strip())
    depth, start = 0, brace + 1
    inside = tree[brace + 1 : tree.rfind("}")]
    start = 0
    for i, char in enumerate(inside + ","):
        depth += {"{": 1, "}": -1}.get(char, 0)
        if char == "," and depth == 0:
            if inside[start:i].strip():
                yield from leaves(inside[start:i], prefix + head)
            start = i + 1


class File:
    def __init__(self, path, module, text):
        self.path, self.module = path, module
        self.uses = []
        for found in USE.finditer(text):
            for target, name in leaves(found[2]):
                self.uses.append((target, name, bool(found[1])))
        self.body = USE.sub("\n", text)
        self.items = set(ITEM.findall(self.body))


class Crate:
    def __init__(self, folder):
        self.files = {}
        source = folder / "src"
        for path in sorted(source.rglob("*.rs")):
            parts = list(path.relative_to(source).with_suffix("").parts)
            if "tests" in parts or any(part.endswith("_tests") for part in parts):
                continue
            if parts[-1] in ("mod", "lib") or parts == ["main"]:
                parts.pop()
            module = tuple(parts)
            self.files.setdefault(module, File(path, module, strip(path.read_text())))

    def resolve(self, module, path, seen=()):
        """The file that defines what `path` means in `module`; None outside of the crate."""
        if (module, path) in seen or not path or len(seen) > 20:
            return None
        seen += ((module, path),)
        head, rest = path[0], path[1:]
        if head == "crate":
            return self.resolve((), rest, seen) if rest else None
        if head == "self":
            return self.resolve(module, rest, seen)
        if head == "super":
            return self.resolve(module[:-1], rest, seen)
        if module + (head,) in self.files:
            inner = module + (head,)
            if not rest or rest == ("*",):
                return inner
            return self.resolve(inner, rest, seen)
        file = self.files.get(module)
        if file is None:
            return None
        for target, name, _ in file.uses:
            if name == head:
                return self.resolve(module, target + rest, seen)
        if head in file.items:
            return module
        for target, name, public in file.uses:
            if name == "*" and public:
                found = self.resolve(module, target[:-1] + path, seen)
                if found is not None:
                    return found
        return None

    def edges(self):
        graph = {}
        for module, file in self.files.items():
            targets = set()
            for target, name, public in file.uses:
                used = name == "*" or re.search(rf"\b{re.escape(name)}\b", file.body)
                if public and not used:
                    continue
                targets.add(self.resolve(module, target))
            for found in PATH.finditer(file.body):
                targets.add(self.resolve(module, tuple(found[1].split("::"))))
            graph[module] = {t for t in targets if t is not None and t != module}
        return graph


def circles(graph):
    """The strongly connected components of more than one node (Tarjan)."""
    index, low, stack, found = {}, {}, [], []

    def visit(node):
        index[node] = low[node] = len(index)
        stack.append(node)
        for target in graph.get(node, ()):
            if target not in index:
                visit(target)
                low[node] = min(low[node], low[target])
            elif target in stack:
                low[node] = min(low[node], index[target])
        if low[node] == index[node]:
            component = []
            while not component or component[-1] != node:
                component.append(stack.pop())
            if len(component) > 1:
                found.append(sorted(component))

    for node in graph:
        if node not in index:
            visit(node)
    return found


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    folders = [pathlib.Path(name) for name in sys.argv[1:]] or [
        root / name for name in ("plant", "controller", "bridge", ".")
    ]
    sys.setrecursionlimit(10_000)
    failed = False
    for folder in folders:
        crate = Crate(folder)
        graph = crate.edges()
        arrows = sum(len(targets) for targets in graph.values())
        print(f"{folder.resolve().name}: {len(graph)} files, {arrows} imports")
        for component in circles(graph):
            failed = True
            print("  a circle of", len(component), "files:")
            for module in component:
                inside = ["::".join(t) or "crate" for t in graph[module] if t in component]
                print(f"    {'::'.join(module) or 'crate'} imports {', '.join(sorted(inside))}")
    return failed


if __name__ == "__main__":
    sys.exit(main())
