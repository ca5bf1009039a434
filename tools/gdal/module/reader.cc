// SPDX-License-Identifier: Apache-2.0
// The reader, by GDAL.
#include <cmath>
#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <filesystem>
#include <gdal.h>
#include <limits>
#include <ogr_srs_api.h>
#include <vector>

#include "tools/gdal/module/module.h"

namespace mtdb {

namespace {

struct CloseDataset {
  void operator()(void* dataset) const { GDALClose(dataset); }
};
using Dataset = std::unique_ptr<void, CloseDataset>;

std::string GdalMessage() {
  std::string message = CPLGetLastErrorMsg();
  while (!message.empty() && (message.back() == '\n' || message.back() == '.')) message.pop_back();
  return message.empty() ? "GDAL gives no reason" : message;
}

bool IsIntegral(GDALDataType type) {
  return type == GDT_Byte || type == GDT_UInt16 || type == GDT_Int16 || type == GDT_UInt32 ||
         type == GDT_Int32;
}

class GdalReader final : public RasterReader {
 public:
  GdalReader(const std::string& path, Dataset dataset) : dataset_(std::move(dataset)) {
    path_ = path;
    band_ = GDALGetRasterBand(dataset_.get(), 1);
  }

  Status Open() {
    if (band_ == nullptr) return Status(StatusCode::kUnsupported, path_ + ": has no band");
    const GDALDataType type = GDALGetRasterDataType(band_);
    if (GDALDataTypeIsComplex(type) != 0) {
      return Status(StatusCode::kUnsupported, path_ + ": complex numbers are no heights");
    }
    const char* const name = GDALGetDriverShortName(GDALGetDatasetDriver(dataset_.get()));
    info_.format = std::string("GDAL ") + (name == nullptr ? "" : name);
    MTDB_RETURN_IF_ERROR(ReadPlace());
    ReadSystem();
    scale_ = GDALGetRasterScale(band_, nullptr);
    offset_ = GDALGetRasterOffset(band_, nullptr);
    if (!std::isfinite(scale_) || scale_ == 0) scale_ = 1;
    if (!std::isfinite(offset_)) offset_ = 0;
    info_.height_step = IsIntegral(type) ? std::abs(scale_) : 0;
    info_.height_origin = IsIntegral(type) ? offset_ : 0;
    RasterFrame& f = info_.frame;
    const std::string type_name = GDALGetDataTypeName(type);
    for (const char c : type_name) f.sample_type += static_cast<char>(std::tolower(c));
    f.height_units = GDALGetRasterUnitType(band_);
    int has_nodata = 0;
    const double nodata = GDALGetRasterNoDataValue(band_, &has_nodata);
    if (has_nodata != 0 && !std::isnan(nodata)) f.nodata = nodata;
    const int flags = GDALGetMaskFlags(band_);
    if ((flags & GMF_ALL_VALID) == 0) mask_ = GDALGetMaskBand(band_);
    return Status::Ok();
  }

  Status ReadRow(uint32_t row, std::span<double> heights) override {
    const int columns = static_cast<int>(heights.size());
    const int y = static_cast<int>(row);
    CPLErrorReset();
    if (GDALRasterIO(band_, GF_Read, 0, y, columns, 1, heights.data(), columns, 1, GDT_Float64, 0,
                     0) != CE_None) {
      return Wrong(row);
    }
    if (mask_ != nullptr) {
      mask_row_.resize(heights.size());
      if (GDALRasterIO(mask_, GF_Read, 0, y, columns, 1, mask_row_.data(), columns, 1, GDT_Byte, 0,
                       0) != CE_None) {
        return Wrong(row);
      }
    }
    for (size_t c = 0; c < heights.size(); ++c) {
      const bool none = (mask_ != nullptr && mask_row_[c] == 0) || !std::isfinite(heights[c]) ||
                        heights[c] == info_.frame.nodata;
      heights[c] = none ? std::numeric_limits<double>::quiet_NaN() : heights[c] * scale_ + offset_;
    }
    return Status::Ok();
  }

 private:
  Status Wrong(uint32_t row) const {
    return BadInput(path_ + ": row " + std::to_string(row) + ": " + GdalMessage());
  }

  Status ReadPlace() {
    RasterFrame& f = info_.frame;
    f.columns = static_cast<uint32_t>(GDALGetRasterXSize(dataset_.get()));
    f.rows = static_cast<uint32_t>(GDALGetRasterYSize(dataset_.get()));
    if (GDALGetGeoTransform(dataset_.get(), f.geotransform.data()) != CE_None) {
      if (GDALGetGCPCount(dataset_.get()) > 0) {
        return Status(StatusCode::kUnsupported,
                      path_ +
                          ": is placed by ground control points; warp it to a grid first, as "
                          "gdalwarp does");
      }
      f.geotransform = {0, 1, 0, 0, 0, -1};
    }
    const char* const area = GDALGetMetadataItem(dataset_.get(), GDALMD_AREA_OR_POINT, nullptr);
    f.is_area = area == nullptr || !EQUAL(area, GDALMD_AOP_POINT);
    return Status::Ok();
  }

  void ReadSystem() {
    const OGRSpatialReferenceH system = GDALGetSpatialRef(dataset_.get());
    if (system == nullptr) return;
    const char* const options[] = {"FORMAT=WKT2_2019", "MULTILINE=NO", nullptr};
    char* text = nullptr;
    if (OSRExportToWktEx(system, &text, options) == OGRERR_NONE && text != nullptr) {
      info_.crs = text;
    }
    CPLFree(text);
    for (const char* const key : {"VERT_DATUM", "VDATUM"}) {
      const char* const datum = OSRGetAttrValue(system, key, 0);
      if (datum != nullptr && info_.frame.vertical_datum.empty()) {
        info_.frame.vertical_datum = datum;
      }
    }
  }

  Dataset dataset_;
  GDALRasterBandH band_ = nullptr;
  GDALRasterBandH mask_ = nullptr;
  double scale_ = 1, offset_ = 0;
  std::vector<uint8_t> mask_row_;
};

}  // namespace

Result<std::unique_ptr<RasterReader>> OpenByGdal(const std::string& path, uint64_t cache_bytes) {
  if (!std::filesystem::exists(path)) {
    return Status(StatusCode::kNotFound, path + ": No such file or directory");
  }
  GDALAllRegister();
  CPLSetErrorHandler(CPLQuietErrorHandler);
  GDALSetCacheMax64(static_cast<GIntBig>(cache_bytes));
  CPLErrorReset();
  Dataset dataset(GDALOpenEx(path.c_str(),
                             GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR, nullptr,
                             nullptr, nullptr));
  if (dataset == nullptr) return Unsupported(path + ": " + GdalMessage());
  auto reader = std::make_unique<GdalReader>(path, std::move(dataset));
  MTDB_RETURN_IF_ERROR(reader->Open());
  return std::unique_ptr<RasterReader>(std::move(reader));
}

}  // namespace mtdb
