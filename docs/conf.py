"""How Sphinx builds the site: `make docs` writes it to build/docs.

The source directory is the project's root, so that a link from one page to another, to a notebook
or to a netlist is the same path on the site as in the repository.
"""

import html
import re
import tomllib
from pathlib import Path

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util import logging

import harvester
from harvester.cli.table import COMMANDS, app_of
from harvester.device.beam.materials import ACTIVE, PASSIVE

LOGGER = logging.getLogger(__name__)
EXAMPLES = Path(__file__).parent / "examples.toml"

project = "harvester"
author = "the authors of harvester"
version = release = harvester.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]
root_doc = "docs/index"
include_patterns = [
    "docs/**.md",
    "docs/reference/api/*.rst",
    "notebooks/*.py",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
]
exclude_patterns = [".*", "build", "results", "*.egg-info"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
# Executed where their code has changed since the last time; a cell that fails is a warning.
nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_execution_timeout = 600
nb_execution_show_tb = True
# Lines that a cell prints one after another form one output.
nb_merge_streams = True
# A page has no kernel that sliders could ask: of those its picture is shown, and no script fetched.
nb_ipywidgets_js = {}
nb_mime_priority_overrides = [("html", "application/vnd.jupyter.widget-view+json", None)]

# Quotation marks are curved; two hyphens remain, since options begin with them.
smartquotes_action = "q"
default_role = "py:obj"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = False

html_theme = "furo"
# The site's root leads to its first page.
html_additional_pages = {"index": "root.html"}
# Absolute, since autosummary looks for templates from the source directory, Sphinx from this one.
templates_path = [str(Path(__file__).parent / "templates")]
autosummary_context = {
    "examples": {
        name: f"import harvester\n{code}"
        for name, code in tomllib.loads(EXAMPLES.read_text("utf-8")).items()
    }
}
html_title = f"harvester {version}"
html_show_copyright = False
# Formulas are MathML: not every machine has a font for them, so that the site brings one.
html_static_path = ["site.css", "stix-two-math.woff"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"


def _mathml(node, as_block=False):
    """A formula as MathML, which browsers set without a script."""
    # Primes are raised, as TeX has them.
    formula = re.sub("'+", lambda primes: "^{" + r"\prime " * len(primes[0]) + "}", node.astext())
    try:
        return tex2mathml(formula, as_block=as_block)
    except MathError as error:
        LOGGER.warning("formula %r: %s", node.astext(), error, location=node)
        return f"<code>{html.escape(node.astext())}</code>"


def _visit_inline_math(writer, node):
    """A formula in a line of text."""
    writer.body.append(_mathml(node))
    raise nodes.SkipNode


def _visit_math_block(writer, node):
    """A formula of its own; what is too wide scrolls."""
    writer.body.append(f'<div class="math">{_mathml(node, as_block=True)}</div>')
    raise nodes.SkipNode


def _commands():
    """Help of all commands, each with its example."""
    app = app_of(COMMANDS)
    text = app.generate_docs(output_format="markdown", recursive=True, heading_level=1)
    _, _, text = text.partition("\n## harvester ")
    for name in COMMANDS:
        usage = f"```console\nharvester {name} "
        assert usage in text, name
        example = app[name].help_epilogue.removeprefix("example: ")
        text = text.replace(usage, f"```console\n{example}\n```\n\n{usage}", 1)
    return f"## harvester {text}"


def _materials():
    """Tables of the materials of beams."""
    rows = ["| name | modulus, GPa | density, kg/m³ | source |", "| --- | --- | --- | --- |"]
    for name, material in PASSIVE.items():
        values = (name, f"{material.modulus / 1e9:.4g}", f"{material.density:g}", material.source)
        rows.append(f"| {' | '.join(values)} |")
    heads = ("name", "1/s11, GPa", "kg/m³", "d31, pm/V", "ε_S/ε0", "strain limit, 1e-4", "source")
    rows += ["", f"| {' | '.join(heads)} |", "| --- " * len(heads) + "|"]
    for name, layer in ACTIVE.items():
        numbers = (
            layer.modulus / 1e9,
            layer.density,
            layer.d31 * 1e12,
            layer.permittivity,
            layer.strain_limit * 1e4,
        )
        cells = (name, *(f"{number:.4g}" for number in numbers), layer.source)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


GENERATED = {"commands": _commands, "materials": _materials}


def _generate(app, docname, source):
    """Replace the marks of generated parts by their text."""
    for name, text in GENERATED.items():
        mark = f"<!-- generated: {name} -->"
        if mark in source[0]:
            source[0] = source[0].replace(mark, text())


def _signature(app, what, name, obj, options, signature, returns):
    """A signature that Sphinx can parse: no default factories, no options of the command line."""
    kind = r"[~\w.]*(?:Kind\([^)]*\)|[A-Z]+)"
    signature = re.sub(rf"[~\w.]*Annotated\[(.+?), {kind}\]", r"\1", signature or "")
    return signature.replace("<factory>", "...") or None, returns


def _dashes(app, doctree):
    """En dashes between a parameter and its description."""
    for text in list(doctree.findall(nodes.Text)):
        if text == " -- ":
            text.parent.replace(text, nodes.Text(" – "))


def setup(app):
    """Register the writer of formulas, the generated parts of pages, and signatures."""
    app.connect("source-read", _generate)
    app.connect("autodoc-process-signature", _signature)
    app.connect("doctree-read", _dashes)
    app.add_html_math_renderer("mathml", (_visit_inline_math, None), (_visit_math_block, None))
