// SPDX-License-Identifier: Apache-2.0
// Loads the module when a raster needs it: GDAL and what it links would cost every start of mtdb
// some 50 ms and 40 MB.
#include <dlfcn.h>
#include <filesystem>
#include <utility>

#include "store/files/guarded_file.h"
#include "tools/gdal/gdal_image.h"
#include "tools/gdal/gdal_raster.h"
#include "tools/gdal/gdal_writer.h"
#include "tools/gdal/module/module.h"

namespace mtdb {

namespace {

constexpr char kModule[] = "libmtdb_gdal_module.so";

// Beside the program or the library that this is a part of, as they are built, or where it is
// installed.
std::vector<std::filesystem::path> ModuleFolders() {
  std::vector<std::filesystem::path> folders;
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (!error) {
    folders = {program.parent_path(), program.parent_path() / ".." / MTDB_GDAL_FOLDER};
  }
  Dl_info self;
  if (dladdr(&kModule, &self) != 0 && self.dli_fname != nullptr) {
    const std::filesystem::path library = std::filesystem::canonical(self.dli_fname, error);
    if (!error) {
      folders.push_back(library.parent_path());
      folders.push_back(library.parent_path() / "mtdb");
    }
  }
  return folders;
}

// Empty: nowhere.
std::string ModulePath() {
  std::error_code error;
  for (const std::filesystem::path& folder : ModuleFolders()) {
    if (std::filesystem::exists(folder / kModule, error)) return (folder / kModule).string();
  }
  return "";
}

// Why there is none.
std::string NoModule() {
  if (!MTDB_GDAL_BUILT) return "this mtdb was built without GDAL";
  std::string text = std::string(kModule) + ", by which this mtdb uses GDAL, is in none of";
  for (const std::filesystem::path& folder : ModuleFolders()) {
    text += " " + folder.lexically_normal().string();
  }
  return text + "; put it beside the program";
}

// How to get it, where it is not there by mistake.
std::string Advice(const std::string& what) {
  return MTDB_GDAL_BUILT ? "" : "; " + what + " build it where libgdal-dev is installed";
}

// Stays loaded.
Result<const GdalEntries*> Load() {
  const std::string path = ModulePath();
  if (path.empty()) return Unsupported(NoModule());
  void* const module = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (module == nullptr) return Unsupported(std::string("GDAL cannot be loaded: ") + dlerror());
  using Entries = const GdalEntries* (*)();
  const auto entries = reinterpret_cast<Entries>(dlsym(module, kGdalEntries));
  if (entries == nullptr) return Unsupported(path + ": is of another mtdb");
  return entries();
}

}  // namespace

bool HasGdal() { return !ModulePath().empty(); }

Result<std::unique_ptr<RasterReader>> OpenGdalRaster(const std::string& path,
                                                     uint64_t cache_bytes) {
  const Result<const GdalEntries*> gdal = Load();
  if (gdal.ok()) return (*gdal)->open(path, cache_bytes);
  return Unsupported(path + ": " + gdal.status().message() + ", and reads by itself " +
                     OwnRasterSuffixes() + Advice("for other rasters"));
}

Result<PlacedImage> ReadGdalImage(const std::string& path) {
  const Result<const GdalEntries*> gdal = Load();
  if (gdal.ok()) return (*gdal)->read_image(path);
  return Unsupported(path + ": " + gdal.status().message() +
                     ", and reads images of PNG and JPEG with a world file beside them" +
                     Advice("for others"));
}

Result<std::unique_ptr<GdalWriter>> CreateGeoTiff(const std::string& path,
                                                  const GdalRaster& raster) {
  MTDB_RETURN_IF_ERROR(CheckReplaceable(path));
  const Result<const GdalEntries*> gdal = Load();
  if (gdal.ok()) return (*gdal)->create(path, raster);
  return Unsupported(path + ": " + gdal.status().message() + ", and writes no GeoTIFF; write .asc" +
                     Advice("for GeoTIFF"));
}

}  // namespace mtdb
