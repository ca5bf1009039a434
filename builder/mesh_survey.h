// SPDX-License-Identifier: Apache-2.0
// SurveyMesh: what a mesh is like before it is stored, and which accuracy suits it.
#pragma once

#include <cstdint>
#include <optional>

#include "builder/build.h"

namespace mtdb {

// Says all that is known of a mesh before it is built, the mesh's components included, and which
// grid BuildObject would choose; stores nothing. Out of core, within options.memory_bytes; the
// components are left out when their table, of four bytes a vertex, does not fit. Errors: those of
// BuildObject that concern the input, the options and the temporary files; but a mesh that is
// refused for what its grid would do to it is surveyed, and MeshSurvey::refusal says why.
Result<MeshSurvey> SurveyMesh(const MeshProducer& input, const BuildOptions& options);

}  // namespace mtdb
