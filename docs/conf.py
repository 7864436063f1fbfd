"""The documentation site: `sphinx-build -W --keep-going docs docs/_build`, with the extra `docs`."""

import tomllib
from pathlib import Path

import matplotlib as mpl
from sphinx.application import Sphinx

import fg_nav

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
REPOSITORY = PROJECT["urls"]["Repository"]

mpl.use("agg")

project, author = PROJECT["name"], PROJECT["authors"][0]["name"]
version = release = PROJECT["version"]
project_copyright = author

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "examples"]
default_role = "code"  # what docstrings put in backticks
html_theme = "furo"
html_title = f"{project} {version}"
html_theme_options = {
    **{"source_repository": REPOSITORY, "source_branch": "main", "source_directory": "docs/"},
    "light_css_variables": {"color-brand-primary": "#1d5f99", "color-brand-content": "#1d5f99"},
    "dark_css_variables": {"color-brand-primary": "#6cb2ee", "color-brand-content": "#6cb2ee"},
}
html_static_path, html_css_files = ["site.css"], ["site.css"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4  # links to sections, as in the checkout
mathjax4_config = {"output": {"displayOverflow": "linebreak"}}  # long equations break, also on a phone

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_default_options = {"members": True, "show-inheritance": True}
autosummary_generate = True
napoleon_google_docstring = False
napoleon_use_ivar = True

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/\d\d_",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("matplotlib",),
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
    "abort_on_example_error": True,
}
linkcheck_ignore = [r"https?://.*"]  # of the network; what is inside is checked by the build


def skip_public(app: Sphinx, what: str, name: str, thing: object, *rest: object) -> bool | None:
    """Describe a public name once, under `fg_nav`, and not again in the module that it comes from."""
    return True if what == "module" and name in fg_nav.__all__ and getattr(fg_nav, name) is thing else None


def setup(app: Sphinx) -> None:
    """Let Sphinx ask what to leave out."""
    app.connect("autodoc-skip-member", skip_public)
