// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/raster_ingest.h"

#include <algorithm>
#include <cctype>
#include <cstdarg>
#include <cstdio>
#include <filesystem>
#include <set>

#include "codecs/mesh_file/mesh_file.h"
#include "codecs/raster_file/raster_file.h"
#include "tools/client/printable.h"
#include "tools/gdal/gdal_raster.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

unsigned long long U(uint64_t v) { return v; }

__attribute__((format(printf, 1, 2))) std::string Text(const char* format, ...) {
  char text[400];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof(text), format, arguments);
  va_end(arguments);
  return text;
}

// Files that are rasters by their names, whoever reads them.
bool HasRasterSuffix(const std::string& path) {
  static const std::set<std::string> kSuffixes{
      ".hgt", ".asc", ".dem", ".tif", ".tiff", ".vrt", ".img", ".adf", ".bil", ".flt",
      ".dt0", ".dt1", ".dt2", ".grd", ".nc",   ".bag", ".jp2", ".bt",  ".ter"};
  std::string suffix = std::filesystem::path(path).extension().string();
  for (char& c : suffix) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return kSuffixes.contains(suffix);
}

Result<std::unique_ptr<RasterReader>> OpenRaster(const std::string& path, uint64_t cache_bytes) {
  Result<std::unique_ptr<RasterReader>> own = OpenOwnRaster(path);
  if (own.status().code() != StatusCode::kUnsupported) return own;
  return OpenGdalRaster(path, cache_bytes);
}

Status CheckOptions(const IngestArguments& a) {
  const char* wrong = nullptr;
  if (a.bits) wrong = "--bits";
  if (a.step) wrong = "--step";
  if (a.lossless) wrong = "--lossless";
  if (a.weld) wrong = "--weld";
  if (a.normal_bits) wrong = "--normals";
  if (!a.attribute_steps.empty()) wrong = "--attribute";
  if (wrong == nullptr) return Status::Ok();
  return InvalidArgument(std::string(wrong) +
                         ": is for meshes; a raster's samples lie where they are, and --step-z "
                         "says to which multiples heights are rounded");
}

}  // namespace

bool IsRaster(const std::string& path) {
  return path != "-" && HasRasterSuffix(path) && !IsMeshFile(path);
}

Result<std::unique_ptr<RasterIngest>> RasterIngest::Open(const IngestArguments& arguments,
                                                         uint64_t memory_bytes) {
  const std::vector<std::string>& paths = arguments.inputs;
  const auto rasters = std::count_if(paths.begin(), paths.end(), IsRaster);
  if (rasters == 0) {
    if (!arguments.step_z) return std::unique_ptr<RasterIngest>();
    return InvalidArgument("--step-z: is for rasters; --step rounds the positions of a mesh");
  }
  MTDB_RETURN_IF_ERROR(CheckOptions(arguments));
  std::vector<std::unique_ptr<RasterReader>> files;
  for (const std::string& path : paths) {
    if (!IsRaster(path)) {
      return BadInput(path + ": is no raster, but " + paths[0] +
                      " or another input is; a mesh and a raster do not become one object");
    }
    MTDB_ASSIGN_OR_RETURN(std::unique_ptr<RasterReader> file, OpenRaster(path, memory_bytes / 8));
    files.push_back(std::move(file));
  }
  MTDB_ASSIGN_OR_RETURN(RasterMosaic mosaic, RasterMosaic::Join(std::move(files)));
  const RasterInfo& info = mosaic.info();
  RasterMeshOptions mesh;
  mesh.height_step = arguments.step_z.value_or(info.height_step);
  mesh.height_origin = info.height_origin;
  if (!(mesh.height_step > 0)) {
    return BadInput(paths[0] + ": heights of type " + info.frame.sample_type +
                    " are rounded to multiples of a step, which --step-z names, e.g. --step-z "
                    "0.01; they may be so exact, and no more");
  }
  return std::unique_ptr<RasterIngest>(new RasterIngest(std::move(mosaic), mesh, paths.size()));
}

TerrainInput RasterIngest::terrain() {
  TerrainInput terrain;
  terrain.frame = mosaic_.info().frame;
  terrain.crs = mosaic_.info().crs;
  terrain.grid = GridOf(terrain.frame, mesh_.height_step, mesh_.height_origin);
  terrain.rounding = [this] { return report_.rounding; };
  return terrain;
}

std::vector<std::string> RasterIngest::Notes() const {
  const RasterFrame& f = mosaic_.info().frame;
  std::vector<std::string> notes;
  if (files_ > 1) {
    const RasterDisagreement& d = mosaic_.disagreement();
    std::string note = Text("%zu files joined to %u x %u samples; %llu lie in more than one",
                            files_, f.columns, f.rows, U(d.overlapping));
    if (d.samples > 0) {
      note += Text(", %llu of them differ, by up to %.9g: the first file's are kept", U(d.samples),
                   d.largest);
    }
    notes.push_back(note);
  }
  if (report_.holes > 0) {
    notes.push_back(Text("%llu of %llu samples have no height: holes", U(report_.holes),
                         U(report_.holes + report_.samples)));
  }
  return notes;
}

Json RasterIngest::ReportJson() const {
  const RasterDisagreement& d = mosaic_.disagreement();
  return {{"files", files_},
          {"samples", report_.samples},
          {"holes", report_.holes},
          {"overlapping", d.overlapping},
          {"differing", d.samples},
          {"largest_difference", d.largest},
          {"rounding", report_.rounding}};
}

void RasterIngest::Print(const std::string& name) const {
  const RasterInfo& info = mosaic_.info();
  const RasterFrame& f = info.frame;
  std::printf("%s\n", Printable(name).c_str());
  std::printf("  raster       %u x %u samples, %s, %s\n", f.columns, f.rows,
              Printable(f.sample_type).c_str(), Printable(info.format).c_str());
  std::printf("  heights      steps of %.9g %s\n", mesh_.height_step,
              Printable(f.height_units).c_str());
  std::printf("  crs          %s\n", info.crs.empty() ? "not known" : Printable(info.crs).c_str());
}

Json RasterIngest::InfoJson() const {
  const RasterInfo& info = mosaic_.info();
  Json json = RasterJson(info.frame, info.crs);
  json["format"] = info.format;
  json["height_step"] = mesh_.height_step;
  return json;
}

}  // namespace mtdb
