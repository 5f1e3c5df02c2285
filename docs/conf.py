"""Sphinx configuration of the manual: `.ci/docs` builds it, and a warning, such as a broken link or anchor, fails."""

import os
import re

project = "Sidehill"
author = "The Sidehill developers"
html_title = "Sidehill"
html_theme = "furo"

extensions = ["myst_parser", "sphinxcontrib.mermaid"]
# Anchors as repository hosts make them, so that links work in both.
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]
nitpicky = True
exclude_patterns = ["schema"]


def link_repository(app, docname, source):
    """Turns links to Markdown outside docs/ into downloads: MyST takes every other file for one by itself."""
    folder = os.path.dirname(docname)

    def linked(match):
        leads = os.path.normpath(os.path.join(folder, match[1]))
        return f"](path:{match[1]})" if leads.startswith("..") else match[0]

    source[0] = re.sub(r"\]\((\.\./[^)#]*\.md)(?:#[^)]*)?\)", linked, source[0])


def setup(app):
    app.connect("source-read", link_repository)
