#!/usr/bin/env python3
"""Finds circles among the source files and the folders of each crate by their `use` declarations and inline paths.

    .ci/import_circles.py [CRATE_FOLDER...]

A path is resolved to the file that declares its item; a `pub use` of a module file is followed to the file behind it.
Declaring a child (`mod`) or passing on its items (`pub use`) is no import. Folders are compared with their siblings, at
every depth: a module with all that is in it. Tests are left out. Exit status 1 with a circle.
"""
import re
import sys
import tomllib
from pathlib import Path


def strip(text):
    """Removes comments, strings and `#[cfg(test)]` items."""
    text = re.sub(r'//[^\n]*', '', text)
    text = re.sub(r'"(?:\\.|[^"\\])*"', '""', text, flags=re.S)
    out, position = [], 0
    for match in re.finditer(r'#\[cfg\(test\)\]\s*', text):
        if match.start() < position:
            continue
        out.append(text[position:match.start()])
        end = match.end()
        semicolon, brace = text.find(';', end), text.find('{', end)
        if brace == -1 or (semicolon != -1 and semicolon < brace):
            position = semicolon + 1
            continue
        depth, at = 0, brace
        while True:
            depth += {'{': 1, '}': -1}.get(text[at], 0)
            at += 1
            if depth == 0:
                break
        position = at
    out.append(text[position:])
    return ''.join(out)


def leaves(tree, prefix=()):
    """The paths of a use tree, each a tuple of names and its local name."""
    tree = tree.strip()
    match = re.match(r'^((?:\w+\s*::\s*)*)\{(.*)\}$', tree, re.S)
    if match:
        head = tuple(p for p in re.split(r'\s*::\s*', match.group(1)) if p)
        depth, part, parts = 0, '', []
        for c in match.group(2):
            depth += {'{': 1, '}': -1}.get(c, 0)
            if c == ',' and depth == 0:
                parts.append(part)
                part = ''
            else:
                part += c
        for part in parts + [part]:
            if part.strip():
                yield from leaves(part, prefix + head)
        return
    name = re.split(r'\s+as\s+', tree)
    path = prefix + tuple(re.split(r'\s*::\s*', name[0].strip()))
    if path[-1] == 'self':
        path = path[:-1]
    yield path, name[1].strip() if len(name) > 1 else path[-1]


def crate(folder):
    source = Path(folder) / 'src'
    modules = {}
    for file in sorted(source.rglob('*.rs')):
        parts = list(file.relative_to(source).with_suffix('').parts)
        if 'tests' in parts or parts[-1].endswith('_tests') or parts == ['main']:
            continue
        if parts[-1] in ('mod', 'lib'):
            parts = parts[:-1]
        modules[tuple(parts)] = file
    texts = {module: strip(file.read_text()) for module, file in modules.items()}
    uses = {}
    for module, text in texts.items():
        uses[module] = []
        for match in re.finditer(r'^\s*(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);', text, re.M):
            for path, name in leaves(match.group(2)):
                uses[module].append((bool(match.group(1)), path, name))

    def absolute(module, path):
        if path[0] == 'crate':
            return path[1:]
        if path[0] == 'self':
            return module + path[1:]
        at = module
        while path and path[0] == 'super':
            at, path = at[:-1], path[1:]
            if not path or path[0] != 'super':
                return at + path
        return module + path if module + path[:1] in modules else None

    def file_of(path, seen=()):
        """The module whose file declares what an absolute path names."""
        for length in range(len(path), -1, -1):
            module = path[:length]
            if module not in modules:
                continue
            rest = path[length:]
            if rest and module not in seen:
                for public, target, name in uses[module]:
                    if public and name in (rest[0], '*'):
                        target = absolute(module, target)
                        if target is not None:
                            found = file_of(target + rest[1:], seen + (module,))
                            if found is not None:
                                return found
            return module
        return None

    edges = {module: set() for module in modules}
    for module, text in texts.items():
        paths = [path for public, path, _ in uses[module] if not public]
        body = re.sub(r'^\s*(pub(?:\([^)]*\))?\s+)?use\s+[^;]+;', '', text, flags=re.M)
        paths += [tuple(p.split('::')) for p in re.findall(r'\b(?:crate|super)(?:::\w+)+', body) if 'pub(' not in p]
        # Children by a path of their own, as `map::drawing()`.
        for match in re.finditer(r'(?<![\w:])([a-z_]\w*)((?:::\w+)+)', body):
            if module + (match.group(1),) in modules:
                paths.append((match.group(1),) + tuple(match.group(2)[2:].split('::')))
        for path in paths:
            target = absolute(module, path)
            found = file_of(target) if target is not None else None
            if found is not None and found != module:
                edges[module].add(found)
    return modules, edges


def circles(edges):
    """The strongly connected components of more than one file or folder (Tarjan)."""
    index, low, stack, on, found = {}, {}, [], set(), []

    def visit(v):
        index[v] = low[v] = len(index)
        stack.append(v)
        on.add(v)
        for w in edges[v]:
            if w not in index:
                visit(w)
                low[v] = min(low[v], low[w])
            elif w in on:
                low[v] = min(low[v], index[w])
        if low[v] == index[v]:
            component = []
            while True:
                w = stack.pop()
                on.discard(w)
                component.append(w)
                if w == v:
                    break
            if len(component) > 1:
                found.append(sorted(component))

    for v in edges:
        if v not in index:
            visit(v)
    return found


def between_siblings(edges):
    """The imports between modules of the same parent, each with all that is in it."""
    out = {}
    for module, imported in edges.items():
        for other in imported:
            shared = 0
            while module[shared:shared + 1] == other[shared:shared + 1] != ():
                shared += 1
            if shared < min(len(module), len(other)):
                out.setdefault(module[:shared + 1], set()).add(other[:shared + 1])
                out.setdefault(other[:shared + 1], set())
    return out


def crates():
    """The folders of the workspace's crates, by its manifest."""
    with open('Cargo.toml', 'rb') as file:
        return ['.', *tomllib.load(file)['workspace']['members']]


def main():
    sys.setrecursionlimit(10000)
    bad = False
    for folder in sys.argv[1:] or crates():
        modules, edges = crate(folder)
        folders = between_siblings(edges)
        found = [(circle, edges) for circle in circles(edges)]
        found += [(circle, folders) for circle in circles(folders) if not any(circle == files for files, _ in found)]
        count = sum(map(len, edges.values()))
        print(f'{folder}: {len(modules)} files, {count} imports, {len(found)} circles')
        for circle, graph in found:
            bad = True
            for module in circle:
                inside = sorted('::'.join(w) or 'lib' for w in graph[module] if w in circle)
                print(f'  {"::".join(module) or "lib"} -> {", ".join(inside)}')
    sys.exit(bad)


if __name__ == "__main__":
    main()
