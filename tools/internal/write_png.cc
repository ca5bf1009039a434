#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <png.h>
#include <unistd.h>

#include "store/base/check.h"
#include "tools/internal/render.h"

namespace mtdb {
namespace {

struct FileCloser {
  void operator()(std::FILE* f) const { std::fclose(f); }
};

Status FileError(const std::string& path, const char* action, int error) {
  const StatusCode code = error == ENOSPC ? StatusCode::kNoSpace : StatusCode::kIoError;
  return Status(code, path + ": cannot " + action + ": " +
                          (error != 0 ? std::strerror(error) : "libpng refused the picture"));
}

Status WriteTo(std::FILE* file, const std::string& path, const RenderImage& image) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.width);
  png.height = static_cast<png_uint_32>(image.height);
  png.format = PNG_FORMAT_RGB;
  errno = 0;
  if (png_image_write_to_stdio(&png, file, 0, image.rgb.data(), 0, nullptr) == 0) {
    const int error = errno;
    png_image_free(&png);
    return FileError(path, "write the picture", error);
  }
  return std::fflush(file) == 0 ? Status::Ok() : FileError(path, "write the picture", errno);
}

}  // namespace

Status WritePng(const std::string& path, const RenderImage& image) {
  MTDB_CHECK(image.width > 0 && image.height > 0 &&
                 image.rgb.size() == size_t{3} * static_cast<size_t>(image.width) *
                                         static_cast<size_t>(image.height),
             "an image has three bytes a pixel");
  const std::string unfinished = path + ".part";
  std::unique_ptr<std::FILE, FileCloser> file(std::fopen(unfinished.c_str(), "wb"));
  if (file == nullptr) return FileError(path, "create a file", errno);
  Status status = WriteTo(file.get(), path, image);
  if (status.ok() && (std::fflush(file.get()) != 0 || ::fdatasync(::fileno(file.get())) != 0)) {
    status = FileError(path, "finish the file", errno);
  }
  if (std::fclose(file.release()) != 0 && status.ok()) {
    status = FileError(path, "finish the file", errno);
  }
  if (status.ok() && std::rename(unfinished.c_str(), path.c_str()) != 0) {
    status = FileError(path, "name the file", errno);
  }
  if (!status.ok()) std::remove(unfinished.c_str());
  return status;
}

}  // namespace mtdb
