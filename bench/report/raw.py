# SPDX-License-Identifier: Apache-2.0
"""What was measured, step by step. To ask for a figure that is not there is an error."""
import json
import pathlib

PUBLISHED = pathlib.Path(__file__).with_name("published.json")


class MissingFigure(Exception):
    """The raw file lacks a figure that the page states."""


class NotMeasured(Exception):
    """A whole step was not run, could not be run here, or failed. The message says which."""


class Row(dict):
    """A row of a step, or an object in it."""

    def __init__(self, values, where):
        super().__init__((key, Row(value, f"{where}.{key}") if isinstance(value, dict) else value)
                         for key, value in values.items())
        self.where = where

    def __missing__(self, key):
        raise MissingFigure(f"{self.where}: there is no figure \"{key}\"")


class Raw:
    def __init__(self, content):
        self.quick = content["quick"]
        self.steps = {step["step"]: step for step in content["steps"]}
        self.published = Row(json.loads(PUBLISHED.read_text()), PUBLISHED.name)

    def step(self, name):
        step = self.steps.get(name)
        if step is None:
            raise NotMeasured(f"Not measured: the step `{name}` was not run.")
        if step.get("unavailable"):
            raise NotMeasured(f"Not measured here: {step['error']}.")
        if not step["ok"]:
            raise NotMeasured(f"**Failed**: {step['error']}")
        return step

    def rows(self, name, **wanted):
        """The rows of a step that have the wanted values, at least one."""
        rows = [Row(row, f"step {name}, row {i}") for i, row in enumerate(self.step(name)["rows"])]
        rows = [row for row in rows if all(row.get(k) == v for k, v in wanted.items())]
        if not rows:
            raise MissingFigure(f"step {name}: there is no row with {wanted or 'figures'}")
        return rows

    def row(self, name, **wanted):
        return self.rows(name, **wanted)[0]

    def google(self, step, family):
        """The rows of a Google Benchmark family, with its arguments under "arguments"."""
        found = []
        for row in self.rows(step):
            parts = row["name"].split("/")
            if parts[0] != family:
                continue
            row["arguments"] = Row({key: int(value) for key, value in (
                part.split(":") for part in parts[1:] if ":" in part)}, row.where)
            found.append(row)
        if not found:
            raise MissingFigure(f"step {step}: there is no benchmark {family}")
        return found


def whole(number):
    return f"{number:,.0f}"


def sig(number, digits=3):
    """With so many significant digits; large numbers without an exponent."""
    text = f"{number:.{digits}g}"
    return f"{float(text):,.0f}" if abs(float(text)) >= 10 ** digits else text


def millis(seconds):
    return sig(1e3 * seconds)


def mib(size_bytes):
    return whole(size_bytes / 2**20)


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows])


def size_name(triangles):
    """2 M, 100 K: of a generated mesh."""
    return f"{triangles / 1e6:.3g} M" if triangles >= 1e6 else f"{triangles / 1e3:.3g} K"


def mesh_name(name):
    """Of a data set, as the page has it."""
    for word, short in (("_colours_normals", ""), ("_bigendian_colours", ""),
                        ("_ascii_boundary", ""), ("_res2_ascii_nonmanifold", ""),
                        (" seed 1", "")):
        name = name.replace(word, short)
    for ending in (".ply", ".off", ".obj"):
        name = name.removesuffix(ending)
    shape, _, triangles = name.replace(" ", "-").partition("-")
    return f"{shape}, {size_name(int(triangles))}" if triangles.isdigit() else name
