# SPDX-License-Identifier: Apache-2.0
"""mtdb: an out-of-core database of triangle meshes. numpy in, numpy out.

    import mtdb

    db = mtdb.open("scans.mtdb", create=True)
    db.ingest(vertices, faces, name="statue", attributes={"red": red, ...})
    mesh = db["statue"].extract(box=[[0, 0, 0], [1, 1, 1]], error=0.001)
    mesh.vertices, mesh.faces, mesh.error_bound
    small = mtdb.simplify(vertices, faces, error=0.01)

docs/python.md tells it in full. The library is libmtdb.so; the GIL is released while it works.
"""
from ._compare import (
    Comparison,
    HeightChange,
    LargestChange,
    OneSided,
    Place,
    compare,
    compare_heights,
)
from ._database import Database, Hit, Object, Server
from ._database import open_database as open
from ._errors import (
    AlreadyExists,
    BadInput,
    BudgetExceeded,
    Busy,
    Cancelled,
    Code,
    Corrupt,
    InvalidArgument,
    IoError,
    MtdbError,
    NoSpace,
    NotFound,
    NotYet,
    RegionMissed,
    Unsupported,
)
from ._library import version as _version
from ._mesh import ExtractStats, Mesh, Saved, Shortfall, png, read_mesh
from ._session import Session, Update, connect, fetch
from ._shortcuts import distance, simplify
from ._terrain import HeightGrid, Profile

__version__: str = _version()

__all__ = [
    "AlreadyExists",
    "BadInput",
    "BudgetExceeded",
    "Busy",
    "Cancelled",
    "Code",
    "Comparison",
    "Corrupt",
    "Database",
    "ExtractStats",
    "HeightChange",
    "HeightGrid",
    "Hit",
    "InvalidArgument",
    "IoError",
    "LargestChange",
    "Mesh",
    "MtdbError",
    "NoSpace",
    "NotFound",
    "NotYet",
    "Object",
    "OneSided",
    "Place",
    "Profile",
    "RegionMissed",
    "Saved",
    "Server",
    "Session",
    "Shortfall",
    "Unsupported",
    "Update",
    "compare",
    "compare_heights",
    "connect",
    "distance",
    "fetch",
    "open",
    "png",
    "read_mesh",
    "simplify",
]
