// SPDX-License-Identifier: Apache-2.0
#include <cctype>
#include <memory>
#include <string>
#include <vector>

#include "codecs/image_file/encode_image.h"
#include "codecs/mesh_file/atomic_file.h"
#include "tools/render/render.h"

namespace mtdb {

namespace {

// Four bytes a pixel; empty when the image is opaque.
std::vector<uint8_t> WithAlpha(const RenderImage& image) {
  std::vector<uint8_t> rgba(4 * image.alpha.size());
  for (size_t i = 0; i < image.alpha.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) rgba[4 * i + c] = image.rgb[3 * i + c];
    rgba[4 * i + 3] = image.alpha[i];
  }
  return rgba;
}

bool EndsAs(const std::string& path, const std::string& suffix) {
  if (path.size() <= suffix.size()) return false;
  std::string end = path.substr(path.size() - suffix.size());
  for (char& c : end) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return end == suffix;
}

Status Put(const std::string& path, const Result<Bytes>& picture) {
  if (!picture.ok()) {
    return Status(picture.status().code(), path + ": " + picture.status().message());
  }
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<AtomicFile> file, AtomicFile::Create(path));
  MTDB_RETURN_IF_ERROR(file->Append(*picture));
  return file->Commit();
}

}  // namespace

Status WritePng(const std::string& path, const RenderImage& image) {
  const std::vector<uint8_t> rgba = WithAlpha(image);
  return Put(path,
             EncodePng(static_cast<uint32_t>(image.width), static_cast<uint32_t>(image.height),
                       rgba.empty() ? 3 : 4, rgba.empty() ? image.rgb : rgba));
}

Status WriteJpeg(const std::string& path, const RenderImage& image) {
  if (!image.alpha.empty()) {
    return InvalidArgument(path + ": JPEG has no transparency; write .png, or draw a background");
  }
  constexpr int kQuality = 92;
  return Put(path, EncodeJpeg(static_cast<uint32_t>(image.width),
                              static_cast<uint32_t>(image.height), image.rgb, kQuality));
}

Status CheckPictureName(const std::string& path) {
  if (EndsAs(path, ".png") || EndsAs(path, ".jpg") || EndsAs(path, ".jpeg")) return Status::Ok();
  return InvalidArgument(path + ": expected a name that ends in .png, .jpg or .jpeg");
}

Status WritePicture(const std::string& path, const RenderImage& image) {
  return EndsAs(path, ".png") ? WritePng(path, image) : WriteJpeg(path, image);
}

}  // namespace mtdb
