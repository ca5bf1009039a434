// SPDX-License-Identifier: Apache-2.0
#include "tools/cli/raster_ingest.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string_view>

#include "store/base/file_kind.h"
#include "tools/cli/grouped.h"
#include "tools/cli/raster_text.h"
#include "tools/client/printable.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

Status CheckOptions(const IngestArguments& a) {
  const char* wrong = nullptr;
  if (a.bits) wrong = "--bits";
  if (a.step) wrong = "--step";
  if (a.lossless) wrong = "--lossless";
  if (a.weld) wrong = "--weld";
  if (a.keep_apart) wrong = "--no-weld";
  if (a.orient) wrong = "--orient";
  if (a.normal_bits) wrong = "--normal-bits";
  if (!a.attribute_steps.empty()) wrong = "--attribute-step";
  if (wrong == nullptr) return Status::Ok();
  return InvalidArgument(
      std::string(wrong) +
      ": is for meshes; a raster's samples lie where they are, and --height-step "
      "says to which multiples heights are rounded");
}

// How the file begins; nothing for what is no file.
std::string StartOf(const std::string& path) {
  std::error_code error;
  if (path == "-" || !std::filesystem::is_regular_file(path, error)) return "";
  std::string start(kFileKindBytes, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(start.data(), static_cast<std::streamsize>(start.size()));
  start.resize(static_cast<size_t>(file.gcount()));
  return start;
}

}  // namespace

Status CheckNoPicture(const std::vector<std::string>& inputs) {
  for (const std::string& path : inputs) {
    const std::string start = StartOf(path);
    const bool png = start.starts_with("\x89PNG\r\n"), jpeg = start.starts_with("\xff\xd8\xff");
    if (!png && !jpeg) continue;
    return BadInput(path + ": is a picture (" + (png ? "PNG" : "JPEG") +
                    "), and neither a mesh nor a raster of heights; --drape of extract, render and "
                    "view lays one over a surface");
  }
  return Status::Ok();
}

Status CheckNoStore(const std::vector<std::string>& inputs) {
  for (const std::string& path : inputs) {
    const std::string start = StartOf(path);
    const bool store = SeemsStore(start);
    if (!store && !SeemsPackedFile(start)) continue;
    return BadInput(path + ": is " + std::string(KindOfFile(start)) + ", not a mesh; 'mtdb " +
                    (store ? "copy" : "unpack") +
                    "' takes its objects to a store, 'mtdb extract' writes one as a mesh file");
  }
  return Status::Ok();
}

Result<std::unique_ptr<RasterIngest>> RasterIngest::Open(const IngestArguments& arguments,
                                                         uint64_t memory_bytes) {
  const std::vector<std::string>& paths = arguments.inputs;
  const auto rasters = std::count_if(paths.begin(), paths.end(), IsRaster);
  if (rasters == 0) {
    if (arguments.fill) return InvalidArgument("--fill: closes holes of rasters, not of meshes");
    if (!arguments.step_z) return std::unique_ptr<RasterIngest>();
    return InvalidArgument("--height-step: is for rasters; --step rounds the positions of a mesh");
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
  MTDB_ASSIGN_OR_RETURN(
      std::unique_ptr<RasterInput> input,
      RasterInput::Join(std::move(files),
                        {arguments.step_z, arguments.fill.value_or(0), memory_bytes}));
  return std::unique_ptr<RasterIngest>(new RasterIngest(std::move(input)));
}

std::vector<std::string> RasterIngest::Notes() const {
  const RasterFrame& f = input_->info().frame;
  std::vector<std::string> notes = input_->info().notes;
  if (input_->files() > 1) {
    const RasterDisagreement& d = input_->disagreement();
    std::string note =
        Formatted("%zu files joined to %u x %u samples; %s lie in more than one", input_->files(),
                  f.columns, f.rows, Grouped(d.overlapping).c_str());
    if (d.samples > 0) {
      note += Formatted(", %s of them differ, by up to %.9g: the first file's are kept",
                        Grouped(d.samples).c_str(), d.largest);
    }
    notes.push_back(note);
  }
  const RasterMeshReport& r = input_->report();
  if (input_->height_step_reason() == HeightStepReason::kChosen) {
    notes.push_back(
        Formatted("heights are rounded to steps of %.9g: %s; --height-step chooses other steps",
                  input_->height_step(), HeightStepReasonText(input_->height_step_reason())));
  }
  if (r.filled.holes > 0 || r.filled.left > 0) {
    std::string note =
        Formatted("%s samples of %s holes got a height", Grouped(r.filled.samples).c_str(),
                  Grouped(r.filled.holes).c_str());
    if (r.filled.left > 0)
      note += Formatted("; %s larger holes were left", Grouped(r.filled.left).c_str());
    notes.push_back(note);
  }
  if (r.holes > 0) {
    notes.push_back(Formatted("%s of %s samples have no height: holes", Grouped(r.holes).c_str(),
                              Grouped(r.holes + r.filled.samples + r.samples).c_str()));
  }
  return notes;
}

Json RasterIngest::ReportJson() const {
  const RasterDisagreement& d = input_->disagreement();
  return {{"files", input_->files()},
          {"samples", input_->report().samples},
          {"holes", input_->report().holes},
          {"filled", input_->report().filled.samples},
          {"filled_holes", input_->report().filled.holes},
          {"larger_holes", input_->report().filled.left},
          {"overlapping", d.overlapping},
          {"differing", d.samples},
          {"largest_difference", d.largest},
          {"height_step", input_->height_step()},
          {"height_step_reason", HeightStepReasonName(input_->height_step_reason())},
          {"rounding", input_->report().rounding}};
}

void RasterIngest::Print(const std::string& name) const {
  const RasterInfo& info = input_->info();
  const RasterFrame& f = info.frame;
  std::printf("%s\n", Printable(name).c_str());
  std::printf("  raster       %s, %s\n", RasterSizeText(f).c_str(), Printable(info.format).c_str());
  std::printf("  samples      %s\n", SamplePlacesText(f).c_str());
  const std::string units = f.height_units.empty() ? "" : " " + Printable(f.height_units);
  std::printf("  heights      steps of %.9g%s: %s", input_->height_step(), units.c_str(),
              HeightStepReasonText(input_->height_step_reason()));
  if (f.nodata) std::printf("; nodata is %.9g", *f.nodata);
  std::printf("\n");
  for (const std::string& note : info.notes) std::printf("  note: %s\n", Printable(note).c_str());
  std::printf("  crs          %s\n", info.crs.empty() ? "not known" : Printable(info.crs).c_str());
}

Json RasterIngest::InfoJson() const {
  const RasterInfo& info = input_->info();
  Json json = RasterJson(info.frame, info.crs);
  json["format"] = info.format;
  json["height_step"] = input_->height_step();
  json["notes"] = info.notes;
  json["height_step_reason"] = HeightStepReasonName(input_->height_step_reason());
  return json;
}

}  // namespace mtdb
