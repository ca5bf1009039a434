// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_page.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <memory>
#include <string_view>
#include <system_error>
#include <zlib.h>

#include "codecs/mesh_file/atomic_file.h"
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

const ServedFile* Find(const std::string& path, const std::vector<ServedFile>& files) {
  const auto at = std::ranges::find(files, path, &ServedFile::name);
  return at == files.end() ? nullptr : &*at;
}

ServerAnswer BesideAnswer(const ServedFile& file) {
  ServerAnswer answer;
  answer.content_type = file.content_type;
  answer.headers = {{"Cache-Control", "no-cache"},
                    {"X-Content-Type-Options", "nosniff"},
                    {"Cross-Origin-Resource-Policy", "same-origin"}};
  answer.body = file.bytes;
  return answer;
}

}  // namespace

bool IsPagePath(const std::string& path, const std::vector<ServedFile>& files) {
  return path.empty() || Find(path) != nullptr || Find(path, files) != nullptr;
}

ServerAnswer PageAnswer(const std::string& path, const std::vector<ServedFile>& files) {
  const ViewerFile* const file = Find(path);
  if (file == nullptr) {
    if (const ServedFile* const beside = Find(path, files)) return BesideAnswer(*beside);
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

namespace {

Result<std::string> Expanded(const ViewerFile& file) {
  constexpr int kGzip = 16 + MAX_WBITS;
  z_stream stream{};
  if (::inflateInit2(&stream, kGzip) != Z_OK)
    return Status(StatusCode::kNoSpace, "no memory to expand the page");
  const std::unique_ptr<z_stream, int (*)(z_stream*)> guard(&stream, &::inflateEnd);
  std::string text;
  std::vector<unsigned char> block(size_t{1} << 16);
  stream.next_in = const_cast<unsigned char*>(file.gzip.data());
  stream.avail_in = static_cast<uInt>(file.gzip.size());
  for (int code = Z_OK; code != Z_STREAM_END;) {
    stream.next_out = block.data();
    stream.avail_out = static_cast<uInt>(block.size());
    code = ::inflate(&stream, Z_NO_FLUSH);
    if (code != Z_OK && code != Z_STREAM_END)
      return Corrupt(std::string(file.name) + " is damaged");
    text.append(block.begin(), block.end() - stream.avail_out);
  }
  return text;
}

// SCHEME://HOST[:PORT], fit for a policy and an attribute.
bool IsOrigin(const std::string& text) {
  std::string_view rest = text;
  if (rest.starts_with("https://")) {
    rest.remove_prefix(8);
  } else if (rest.starts_with("http://")) {
    rest.remove_prefix(7);
  } else {
    return false;
  }
  return !rest.empty() && std::ranges::all_of(rest, [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '.' || c == '-' || c == ':' || c == '[' || c == ']';
  });
}

}  // namespace

Status WritePage(const std::string& folder, const std::vector<std::string>& sources) {
  MTDB_RETURN_IF_ERROR(CheckViewer());
  const std::string own = "connect-src 'self'";
  std::string allowed = own;
  for (const std::string& source : sources) {
    if (!IsOrigin(source)) {
      return InvalidArgument("'" + source + "' is no origin; expected one as https://example.org");
    }
    allowed += " " + source;
  }
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return IoError(folder + ": cannot be made: " + error.message());
  for (const ViewerFile& file : ViewerFiles()) {
    MTDB_ASSIGN_OR_RETURN(std::string text, Expanded(file));
    if (std::string_view(file.name) == "index.html") {
      const size_t at = text.find(own);
      MTDB_CHECK(at != std::string::npos, "the page has a policy");
      text.replace(at, own.size(), allowed);
    }
    const std::string path = (std::filesystem::path(folder) / file.name).string();
    MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<AtomicFile> out, AtomicFile::Create(path));
    MTDB_RETURN_IF_ERROR(out->Append(text));
    MTDB_RETURN_IF_ERROR(out->Commit());
  }
  return Status::Ok();
}

Status CheckViewer() {
  if (!ViewerFiles().empty()) return Status::Ok();
  return Status(StatusCode::kUnsupported,
                std::string("this mtdb was built without the viewer: ") + WhyNoViewerFiles());
}

}  // namespace mtdb
