# SPDX-License-Identifier: Apache-2.0
"""From the raw file to docs/BENCHMARKS.md, its plots and the README's figures.

The page is page.md.in with {{name}} replaced: a function of tables.py, "plot NAME" of plots.py, or
"commands STEP". What a step did not measure is said in its section; what the raw file lacks of a
step that was measured is an error.
"""
import json
import pathlib
import re
import shutil

import plots
import tables
from raw import MissingFigure, NotMeasured, Raw

TEMPLATE = pathlib.Path(__file__).with_name("page.md.in")
README = pathlib.Path(__file__).resolve().parents[2] / "README.md"
BEGIN, END = "<!-- figures: made by tools/benchmark -->", "<!-- end of figures -->"
PLACE = re.compile(r"\{\{([^}]*)\}\}")


def commands(raw, step):
    return "\n".join("    " + command for command in raw.step(step)["command"])


def fill(raw, text, folder):
    """The text with its figures. Raises NotMeasured."""
    def value(match):
        name, _, of = match.group(1).partition(" ")
        if name == "plot":
            plots.PLOTS[of](raw, folder / f"{of}.svg")
            return f"![{of.replace('_', ' ')}](benchmarks/{of}.svg)"
        if name == "commands":
            return commands(raw, of)
        return str(tables.FIGURES[name](raw))
    return PLACE.sub(value, text)


def page(raw, folder):
    sections = re.split(r"(?m)^(?=##+ )", TEMPLATE.read_text())
    filled = []
    for section in sections:
        try:
            filled.append(fill(raw, section, folder))
        except NotMeasured as reason:
            heading = fill(raw, section.split("\n")[0], folder)
            filled.append(f"{heading}\n\n{reason}\n\n")
    return re.sub(r"\n{3,}", "\n\n", "".join(filled)).strip() + "\n"


def readme_figures(raw):
    try:
        caption = tables.picture_caption(raw)
        return (f"{tables.quick_warning(raw)}![{caption}](docs/benchmarks/box.png)\n\n"
                f"{caption}.\n\n{tables.summary(raw)}\n\n"
                "Measured by `tools/benchmark`, with peers in the same run: "
                "[docs/BENCHMARKS.md](docs/BENCHMARKS.md).")
    except NotMeasured as reason:
        return str(reason)


def write(content, output, picture):
    """Writes docs/ and README.md below `output`, and returns the page. `picture` is the folder that
    box.png may be in."""
    raw = Raw(content)
    folder = output / "docs" / "benchmarks"
    folder.mkdir(parents=True, exist_ok=True)
    text = page(raw, folder)
    readme = (output / "README.md" if (output / "README.md").exists() else README).read_text()
    if BEGIN not in readme or END not in readme:
        raise MissingFigure("README.md: the marks of the figures are not there")
    before, rest = readme.split(BEGIN)
    readme = f"{before}{BEGIN}\n{readme_figures(raw)}\n{END}{rest.split(END)[1]}"
    for plot in folder.glob("*.svg"):  # of steps that did not end well this time
        if f"benchmarks/{plot.name}" not in text:
            plot.unlink()
    (folder / "results.json").write_text(json.dumps(content, indent=1) + "\n")
    (output / "docs" / "BENCHMARKS.md").write_text(text)
    (output / "README.md").write_text(readme)
    if (picture / "box.png").exists():
        shutil.copyfile(picture / "box.png", folder / "box.png")
    return text
