# SPDX-License-Identifier: Apache-2.0
"""Exceptions. Each has a code, as tools/c/mtdb.h pins them."""
from __future__ import annotations

import enum
import re


class Code(enum.IntEnum):
    """1xx the caller, 2xx bytes, 3xx the system."""

    INVALID_ARGUMENT = 100
    NOT_FOUND = 101
    ALREADY_EXISTS = 102
    UNSUPPORTED = 103
    CANCELLED = 104
    BUDGET_EXCEEDED = 105
    BAD_INPUT = 200
    CORRUPT = 201
    IO_ERROR = 300
    NO_SPACE = 301
    BUSY = 302
    NOT_YET = 303


class MtdbError(Exception):
    """What mtdb refuses: `code`, and a line that says what is wrong, where, and what to do."""

    code: Code = Code.IO_ERROR

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message = message

    def __str__(self) -> str:
        return self.message


class InvalidArgument(MtdbError, ValueError):
    code = Code.INVALID_ARGUMENT


class NotFound(MtdbError, KeyError):
    """No such file, or no such object."""

    code = Code.NOT_FOUND


class AlreadyExists(MtdbError):
    code = Code.ALREADY_EXISTS


class Unsupported(MtdbError):
    code = Code.UNSUPPORTED


class Cancelled(MtdbError):
    code = Code.CANCELLED


class BudgetExceeded(MtdbError):
    code = Code.BUDGET_EXCEEDED


class BadInput(MtdbError, ValueError):
    code = Code.BAD_INPUT


class Corrupt(MtdbError):
    code = Code.CORRUPT


class IoError(MtdbError, OSError):
    code = Code.IO_ERROR


class NoSpace(MtdbError):
    """Disk or memory is full."""

    code = Code.NO_SPACE


class Busy(MtdbError):
    code = Code.BUSY


class NotYet(MtdbError):
    code = Code.NOT_YET


class RegionMissed(UserWarning):
    """Nothing of the surface is in the region that was asked for, so the mesh is as coarse as it
    gets, or empty."""


_CLASSES = {int(c.code): c for c in MtdbError.__subclasses__()}


#: Options of the command line that messages of the library advise, as keyword arguments.
OPTIONS = {
    "bits": "bits", "cache": "cache_bytes", "clip": "clip", "fill": "fill", "replace": "replace",
    "lossless": "lossless", "memory": "memory_bytes", "name": "name", "resume": "resume",
    "max-tmp": "max_tmp_bytes", "no-weld": "weld=False", "orient": "orient=True", "step": "step", "height-step": "height_step",
    "terrain": "terrain", "tmp": "tmp_directory", "weld": "weld",
}
#: What begins a message, and is called otherwise here: members of the C interface's structs.
ARGUMENTS = {"memory": "memory_bytes", "positions": "vertices", "indices": "faces"}
_PLACES = ((re.compile(r"^vertex (\d+):"), r"vertices[\1]:"),
           (re.compile(r"^triangle (\d+):"), r"faces[\1]:"),
           (re.compile(r"^step of attribute ([^:]*):"), r"attribute_steps['\1']:"))
_MEMBER = re.compile(r"^(?:options|input)(?:\.|: )")
_OPTION = re.compile(r"(?<![\w-])--([a-z]+(?:-[a-z]+)*)(?![\w-])")


def in_python(message: str) -> str:
    """A message of the library, with arguments of this package for options of the command line and
    for members of structs."""
    for place, ours in _PLACES:
        message = place.sub(ours, message)
    first, colon, rest = _MEMBER.sub("", message).partition(":")
    message = ARGUMENTS.get(first, first) + colon + rest
    return _OPTION.sub(lambda found: OPTIONS.get(found[1], found[0]), message)


def make_error(code: int, message: str) -> MtdbError:
    return _CLASSES.get(code, MtdbError)(in_python(message))
