// SPDX-License-Identifier: Apache-2.0
// Images, by GDAL.
#include <algorithm>
#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cpl_vsi.h>
#include <filesystem>
#include <gdal.h>
#include <gdal_utils.h>
#include <ogr_srs_api.h>
#include <unistd.h>

#include "tools/gdal/module/module.h"

namespace mtdb {

namespace {

constexpr int kMostSide = 8192;

struct CloseDataset {
  void operator()(void* dataset) const { GDALClose(dataset); }
};
using Dataset = std::unique_ptr<void, CloseDataset>;

// What makes a PNG of it: red, green, blue, and alpha where it has that.
std::vector<std::string> ArgumentsFor(void* dataset) {
  std::vector<std::string> arguments{"-of", "PNG"};
  const auto add = [&](std::initializer_list<const char*> more) {
    arguments.insert(arguments.end(), more.begin(), more.end());
  };
  const int bands = GDALGetRasterCount(dataset);
  const GDALRasterBandH first = GDALGetRasterBand(dataset, 1);
  if (GDALGetRasterColorTable(first) != nullptr) {
    add({"-expand", "rgb"});
  } else if (bands >= 3) {
    add({"-b", "1", "-b", "2", "-b", "3"});
    if (bands > 3 &&
        GDALGetRasterColorInterpretation(GDALGetRasterBand(dataset, 4)) == GCI_AlphaBand) {
      add({"-b", "4"});
    }
  } else {
    add({"-b", "1"});
  }
  if (GDALGetRasterDataType(first) != GDT_Byte) add({"-ot", "Byte", "-scale"});
  const int columns = GDALGetRasterXSize(dataset), rows = GDALGetRasterYSize(dataset);
  if (std::max(columns, rows) > kMostSide) {
    const double part = static_cast<double>(kMostSide) / std::max(columns, rows);
    for (const std::string& text :
         {std::string("-outsize"), std::to_string(std::max(1, static_cast<int>(columns * part))),
          std::to_string(std::max(1, static_cast<int>(rows * part))), std::string("-r"),
          std::string("average")}) {
      arguments.push_back(text);
    }
  }
  return arguments;
}

Status Wrong(const std::string& path) {
  const std::string message = CPLGetLastErrorMsg();
  return BadInput(path + ": " + (message.empty() ? "GDAL gives no reason" : message));
}

std::string WktOf(void* dataset) {
  const OGRSpatialReferenceH system = GDALGetSpatialRef(dataset);
  const char* const options[] = {"FORMAT=WKT2_2019", "MULTILINE=NO", nullptr};
  char* text = nullptr;
  std::string wkt;
  if (system != nullptr && OSRExportToWktEx(system, &text, options) == OGRERR_NONE) wkt = text;
  CPLFree(text);
  return wkt;
}

}  // namespace

Result<PlacedImage> ReadImageByGdal(const std::string& path) {
  if (!std::filesystem::exists(path)) {
    return Status(StatusCode::kNotFound, path + ": No such file or directory");
  }
  GDALAllRegister();
  CPLSetErrorHandler(CPLQuietErrorHandler);
  CPLErrorReset();
  const Dataset dataset(
      GDALOpenEx(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, nullptr, nullptr, nullptr));
  if (dataset == nullptr || GDALGetRasterCount(dataset.get()) == 0) {
    return Unsupported(path + ": is no image that GDAL knows");
  }
  PlacedImage image;
  image.columns = static_cast<uint32_t>(GDALGetRasterXSize(dataset.get()));
  image.rows = static_cast<uint32_t>(GDALGetRasterYSize(dataset.get()));
  if (GDALGetGeoTransform(dataset.get(), image.geotransform.data()) != CE_None) {
    return Unsupported(path +
                       ": the image has no place: it needs a geotransform, or a world file "
                       "beside it");
  }
  image.crs = WktOf(dataset.get());
  CPLStringList arguments;
  for (const std::string& text : ArgumentsFor(dataset.get())) arguments.AddString(text.c_str());
  GDALTranslateOptions* const options = GDALTranslateOptionsNew(arguments.List(), nullptr);
  const std::string name = "/vsimem/mtdb" + std::to_string(getpid()) + ".png";
  int wrong = 0;
  const GDALDatasetH png = GDALTranslate(name.c_str(), dataset.get(), options, &wrong);
  GDALTranslateOptionsFree(options);
  if (png == nullptr) return Wrong(path);
  GDALClose(png);
  vsi_l_offset size = 0;
  GByte* const bytes = VSIGetMemFileBuffer(name.c_str(), &size, 1);
  if (bytes == nullptr || size == 0) return Wrong(path);
  image.bytes.assign(reinterpret_cast<const char*>(bytes), static_cast<size_t>(size));
  CPLFree(bytes);
  image.mime_type = "image/png";
  return image;
}

}  // namespace mtdb
