// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_page.h"

#include <algorithm>

#include "tools/viewer/viewer_files.h"

namespace mtdb::internal {

namespace {

// What the page may load: its own files and answers of this server, WebAssembly among them.
// Pictures that it makes are blobs.
constexpr const char* kContentSecurityPolicy =
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; connect-src "
    "'self'; style-src 'self'; img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'";

const ViewerFile* Find(const std::string& path) {
  const std::string name = path.empty() ? "index.html" : path;
  const auto files = ViewerFiles();
  const auto at =
      std::ranges::find_if(files, [&](const ViewerFile& file) { return name == file.name; });
  return at == files.end() ? nullptr : &*at;
}

}  // namespace

bool IsPagePath(const std::string& path) { return path.empty() || Find(path) != nullptr; }

ServerAnswer PageAnswer(const std::string& path) {
  const ViewerFile* const file = Find(path);
  if (file == nullptr) {
    return ErrorAnswer(404, "no_viewer",
                       std::string("this mtdb was built without the viewer: ") +
                           WhyNoViewerFiles() + "; objects and meshes are at /objects");
  }
  ServerAnswer answer;
  answer.content_type = file->content_type;
  answer.headers = {{"Content-Encoding", "gzip"},
                    {"Cache-Control", "no-cache"},
                    {"Content-Security-Policy", kContentSecurityPolicy},
                    {"X-Content-Type-Options", "nosniff"},
                    {"Referrer-Policy", "no-referrer"},
                    {"Cross-Origin-Opener-Policy", "same-origin"},
                    {"Cross-Origin-Resource-Policy", "same-origin"}};
  answer.body.assign(reinterpret_cast<const char*>(file->gzip.data()), file->gzip.size());
  return answer;
}

}  // namespace mtdb::internal

namespace mtdb {

Status CheckViewer() {
  if (!ViewerFiles().empty()) return Status::Ok();
  return Status(StatusCode::kUnsupported,
                std::string("this mtdb was built without the viewer: ") + WhyNoViewerFiles());
}

}  // namespace mtdb
