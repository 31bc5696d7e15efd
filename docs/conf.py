"""The documentation site: ``nox -s docs`` builds it from ``docs/`` and the installed package.

Everything a page loads is in the built folder (decision 0074). ``_ext`` has the extensions of our
own: formulas as MathML, and a page for each verb, written from the parser.
"""

import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS / "_ext"))

from figure_scraper import figure_scraper  # noqa: E402 - after the path

import fembridge as fb  # noqa: E402

project = "fembridge"
author = "The fembridge developers"
project_copyright = author
release = version = fb.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "sphinx_design",
    "sphinx_copybutton",
    "formulas",
    "playground",
    "explored_touch",
    "verb_pages",
    "made_pictures",
]
templates_path = ["_templates"]  # a class with all its methods on one page
exclude_patterns = ["_build", "_templates", "playground", "examples", "examples_*"]
smartquotes = False  # two hyphens begin an option
suppress_warnings = ["config.cache"]  # the gallery's configuration holds functions

# Pages
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "attrs_inline", "attrs_block"]
myst_heading_anchors = 4
html_math_renderer = "mathml"

# Reference
autosummary_generate = True
autodoc_typehints = "none"  # the descriptions have the types in words
default_role = "py:obj"  # a name in single backticks is a link where there is such an object
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

# Gallery
sphinx_gallery_conf = {
    "examples_dirs": ["examples"],
    "gallery_dirs": ["gallery"],
    "filename_pattern": r"/plot_",
    "image_scrapers": (figure_scraper,),
    "write_computation_times": False,  # its page loads scripts from elsewhere
    "show_memory": False,
    "min_reported_time": 3600,
    "download_all_examples": False,
    "plot_gallery": True,
    "thumbnail_size": (560, 380),
    "abort_on_example_error": True,
    "remove_config_comments": True,
    "matplotlib_animations": False,
    "parallel": False,
}

# Look
html_theme = "pydata_sphinx_theme"
html_title = "fembridge"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "header_links_before_dropdown": 7,
    "navbar_align": "left",
    "navbar_persistent": [],
    "navbar_end": ["search-button-field", "theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_prev_next": False,
    "show_toc_level": 2,
    "navigation_with_keys": False,
}
html_sidebars = {"index": [], "start": [], "gallery/index": []}
copybutton_exclude = ".linenos, .gp, .go"
