// SPDX-License-Identifier: Apache-2.0
// BuildObjectWith: a build by any decimator, that is, any error measure and filling rule.
#pragma once

#include <functional>
#include <memory>

#include "builder/build.h"
#include "builder/decimate/decimator.h"

namespace mtdb::internal {

// Makes the decimator of a thread.
using DecimatorFactory = std::function<std::unique_ptr<TileDecimator>()>;

// BuildObject is this with SurfaceDecimator. A journal does not know of the decimator: it must not
// be gone on with by another one.
Result<ObjectRecord> BuildObjectWith(const DecimatorFactory& make_decimator,
                                     const MeshProducer& input, const BuildOptions& options,
                                     ObjectWriter& writer, const ProgressCallback& progress = {},
                                     BuildReport* report = nullptr);

}  // namespace mtdb::internal
