// SPDX-License-Identifier: Apache-2.0
// The viewer's page, as tools/viewer/build.mjs makes it: files that are embedded in the program.
#pragma once

#include <span>

namespace mtdb {

struct ViewerFile {
  const char* name;  // "index.html"
  const char* content_type;
  std::span<const unsigned char> gzip;
};

// Empty when the page could not be built.
std::span<const ViewerFile> ViewerFiles();
// Then why, as a part of a sentence; "" otherwise.
const char* WhyNoViewerFiles();

}  // namespace mtdb
