// SPDX-License-Identifier: Apache-2.0
// What is up, found from a shape. Ingest finds it once, and the object's record keeps it.
#pragma once

#include <span>

#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"

namespace mtdb {

// A guess at what is up, a unit vector: where an open surface faces, as terrain does; else the side
// opposite the base on which the mesh stands, or where it has none, z or y. A coarse mesh is
// enough. Takes memory for six points a triangle.
Vec3d EstimateUp(const TriangleMesh& mesh);

// How far the points reach along a unit vector; 0 without any.
double ExtentAlong(std::span<const Vec3d> points, Vec3d along);

}  // namespace mtdb
