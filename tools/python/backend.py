# SPDX-License-Identifier: Apache-2.0
"""Builds wheels and source archives of the package (PEP 517), without other packages.

The wheel has the Python files and libmtdb.so, and is for every Python 3 on this kind of machine: the
binding has no compiled part of its own. --config-setting library=PATH takes a library that is built
already.
"""
from __future__ import annotations

import base64
import gzip
import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile
from pathlib import Path
from typing import Any, Optional

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "tools" / "python" / "mtdb"
# What a source archive has.
SOURCES = ("CMakeLists.txt", "LICENSE", "README.md", "CHANGELOG.md", "pyproject.toml", "cmake",
           "store", "codecs", "query", "builder", "tools", "docs", "tests", "bench")
Settings = Optional[dict[str, Any]]


def version() -> str:
    """That of CMakeLists.txt, the one place that has it."""
    found = re.search(r"project\(mtdb VERSION ([0-9.]+)", (ROOT / "CMakeLists.txt").read_text())
    assert found is not None
    return found[1]


def metadata() -> str:
    text = (ROOT / "pyproject.toml").read_text()

    def value(key: str) -> str:
        found = re.search(rf'^{key} = "?([^"\n]*)"?$', text, re.MULTILINE)
        assert found is not None, key
        return found[1]

    needs = re.search(r"^dependencies = \[(.*)\]$", text, re.MULTILINE)
    assert needs is not None
    lines = ["Metadata-Version: 2.1", "Name: mtdb", f"Version: {version()}",
             f"Summary: {value('description')}", "License: Apache-2.0",
             f"Requires-Python: {value('requires-python')}"]
    lines += [f"Requires-Dist: {need}" for need in re.findall(r'"([^"]+)"', needs[1])]
    lines += ["Description-Content-Type: text/markdown", "", (ROOT / "README.md").read_text()]
    return "\n".join(lines)


def tag() -> str:
    return "py3-none-" + re.sub(r"[-.]", "_", sysconfig.get_platform())


# Headers that the library is compiled from, and the Debian packages that have them (cmake/packages.txt).
HEADERS = {
    "lmdb.h": "liblmdb-dev", "zstd.h": "libzstd-dev", "xxhash.h": "libxxhash-dev", "zlib.h": "zlib1g-dev",
    "draco/mesh/mesh.h": "libdraco-dev", "embree3/rtcore.h": "libembree-dev", "png.h": "libpng-dev",
    "jpeglib.h": "libjpeg62-turbo-dev", "CLI/CLI.hpp": "libcli11-dev", "boost/version.hpp": "libboost-dev",
    "nlohmann/json.hpp": "nlohmann-json3-dev", "meshoptimizer.h": "libmeshoptimizer-dev",
}
PROGRAMS = {"c++": "build-essential", "strip": "build-essential", "cmake": "cmake", "ninja": "ninja-build"}


def missing_packages() -> list[str]:
    """What a build lacks, as Debian calls it."""
    lacking = {package for program, package in PROGRAMS.items() if shutil.which(program) is None}
    compiler = os.environ.get("CXX", "c++")
    if shutil.which(compiler) is None:
        return sorted(lacking | set(HEADERS.values()))
    asks = "".join(f"#if !__has_include(<{header}>)\nLACKS {package}\n#endif\n"
                   for header, package in HEADERS.items())
    found = subprocess.run([compiler, "-E", "-P", "-x", "c++", "-std=c++20", "-"], input=asks,
                           stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
    return sorted(lacking | set(re.findall(r"^LACKS (\S+)$", found.stdout, re.MULTILINE)))


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Nothing from an index. Says what is missing before anything is compiled, which takes minutes."""
    if not (config_settings or {}).get("library"):
        missing = missing_packages()
        if missing:
            raise SystemExit(
                "mtdb: building libmtdb.so takes a C++20 compiler (g++ 12), CMake, ninja and libraries. "
                f"Missing here, by the names of Debian 12: {' '.join(missing)}\n"
                f"Install them:   apt install {' '.join(missing)}\n"
                "or use a library that is built already:   "
                "pip install . --config-settings library=PATH/libmtdb.so"
            )
        print("mtdb: libmtdb.so is compiled now, which takes about 12 minutes on two processors",
              file=sys.stderr)
    return []


def library(settings: Settings, work: Path) -> bytes:
    """The bytes of libmtdb.so, without its symbols for debuggers."""
    given = (settings or {}).get("library")
    if given:
        built = Path(str(given))
    else:
        configure = ["cmake", "-S", str(ROOT), "-B", str(work / "build"), "-G", "Ninja",
                     "-DMTDB_TESTS=OFF", "-DMTDB_BENCH=OFF"]
        subprocess.run(configure, check=True, stdout=sys.stderr)
        subprocess.run(["ninja", "-C", str(work / "build"), "mtdb_c"], check=True,
                       stdout=sys.stderr)
        built = work / "build" / "tools" / "libmtdb.so"
    stripped = work / "libmtdb.so"
    subprocess.run(["strip", "--strip-unneeded", "-o", str(stripped), str(built)], check=True)
    return stripped.read_bytes()


def python_files() -> list[tuple[str, bytes]]:
    files = sorted(p for p in PACKAGE.iterdir() if p.suffix == ".py" or p.name == "py.typed")
    return [("mtdb/" + p.name, p.read_bytes()) for p in files]


def build_wheel(wheel_directory: str, config_settings: Settings = None,
                metadata_directory: Optional[str] = None) -> str:
    folder = f"mtdb-{version()}.dist-info"
    with tempfile.TemporaryDirectory() as work:
        files = python_files() + [("mtdb/libmtdb.so", library(config_settings, Path(work)))]
    wheel = f"Wheel-Version: 1.0\nGenerator: mtdb\nRoot-Is-Purelib: false\nTag: {tag()}\n"
    files += [
        (f"{folder}/METADATA", metadata().encode()),
        (f"{folder}/WHEEL", wheel.encode()),
        (f"{folder}/LICENSE", (ROOT / "LICENSE").read_bytes()),
    ]
    record = ""
    name = f"mtdb-{version()}-{tag()}.whl"
    with zipfile.ZipFile(Path(wheel_directory) / name, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in files:
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            record += f"{path},sha256={digest},{len(data)}\n"
            put(archive, path, data)
        put(archive, f"{folder}/RECORD", (record + f"{folder}/RECORD,,\n").encode())
    return name


def put(archive: zipfile.ZipFile, path: str, data: bytes) -> None:
    """The same bytes on every day."""
    info = zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0))
    info.external_attr = (0o755 if path.endswith(".so") else 0o644) << 16
    info.compress_type = zipfile.ZIP_DEFLATED
    archive.writestr(info, data)


def build_sdist(sdist_directory: str, config_settings: Settings = None) -> str:
    folder = f"mtdb-{version()}"

    def clean(entry: tarfile.TarInfo) -> Optional[tarfile.TarInfo]:
        name = os.path.basename(entry.name)
        if name in ("node_modules", "__pycache__") or name.endswith((".pyc", ".so")):
            return None
        entry.uid = entry.gid = 0
        entry.uname = entry.gname = ""
        return entry

    path = Path(sdist_directory) / f"{folder}.tar.gz"
    with gzip.open(path, "wb") as packed, tarfile.open(fileobj=packed, mode="w") as archive:
        for name in SOURCES:
            archive.add(ROOT / name, f"{folder}/{name}", filter=clean)
        data = metadata().encode()
        entry = tarfile.TarInfo(f"{folder}/PKG-INFO")
        entry.size = len(data)
        archive.addfile(entry, io.BytesIO(data))
    return path.name
