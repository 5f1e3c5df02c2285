"""Sphinx configuration of the manual: `.ci/docs` builds it, and a warning, such as a broken link or anchor, fails."""

import os
import re

project = "Sidehill"
author = "The Sidehill developers"
html_title = "Sidehill"
html_theme = "furo"

extensions = ["myst_parser", "sphinxcontrib.mermaid", "autoapi.extension"]
# Anchors as repository hosts make them, so that links work in both.
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]
nitpicky = True
exclude_patterns = ["schema"]

# The Python module's reference, from its stubs and docstrings; nothing is compiled or imported.
autoapi_dirs = ["../bridge/python/python"]
autoapi_root = "python_api"
autoapi_add_toctree_entry = False
autoapi_options = ["members", "imported-members", "show-module-summary"]
autoapi_python_class_content = "both"
autoapi_member_order = "bysource"
autoapi_keep_files = False
# Types of other packages and of the core's private names have no page here.
nitpick_ignore_regex = [("py:.*", ".*")]


def link_repository(app, docname, source):
    """Turns links to Markdown outside docs/ into downloads: MyST takes every other file for one by itself."""
    folder = os.path.dirname(docname)

    def linked(match):
        leads = os.path.normpath(os.path.join(folder, match[1]))
        return f"](path:{match[1]})" if leads.startswith("..") else match[0]

    source[0] = re.sub(r"\]\((\.\./[^)#]*\.md)(?:#[^)]*)?\)", linked, source[0])


def restructured(app, what, name, obj, options, lines):
    """Turns a docstring as help() shows it into reStructuredText: names in code font, arguments as a list of them."""
    out = []
    for line in lines:
        parts = re.split(r"(`[^`]*`)", line)
        line = "".join(f"`{part}`" if part[:1] == "`" else re.sub(r"([*|]|_\b)", r"\\\1", part) for part in parts)
        argument = re.match(r"([a-z]\w*(?:, [a-z]\w*)*): ", line)
        if argument:
            line = f":param {argument[1]}: {line[argument.end():]}"
        elif out and out[-1] and line[:1].strip() and (out[-1].startswith(":param ") or out[-1].startswith("    ")):
            out.append("")
        out.append(line)
    lines[:] = out


def setup(app):
    app.connect("source-read", link_repository)
    app.connect("autodoc-process-docstring", restructured)
