// SPDX-License-Identifier: Apache-2.0
// The writer, by GDAL.
#include <cerrno>
#include <cmath>
#include <cpl_conv.h>
#include <cpl_error.h>
#include <cpl_string.h>
#include <cstdio>
#include <cstring>
#include <gdal.h>
#include <ogr_srs_api.h>
#include <unistd.h>
#include <vector>

#include "store/files/guarded_file.h"
#include "tools/gdal/module/module.h"

namespace mtdb {

namespace {

GDALDataType TypeOf(const std::string& name) {
  if (name == "byte") return GDT_Byte;
  if (name == "uint16") return GDT_UInt16;
  if (name == "int16") return GDT_Int16;
  if (name == "uint32") return GDT_UInt32;
  if (name == "int32") return GDT_Int32;
  if (name == "float32") return GDT_Float32;
  return GDT_Float64;
}

class GeoTiffWriter final : public GdalWriter {
 public:
  explicit GeoTiffWriter(const std::string& path)
      : path_(path), temporary_(path + "." + std::to_string(getpid()) + ".tmp") {}
  ~GeoTiffWriter() override {
    if (dataset_ != nullptr) GDALClose(dataset_);
    if (!done_) std::remove(temporary_.c_str());
  }

  Status Create(const GdalRaster& raster) {
    GDALAllRegister();
    CPLSetErrorHandler(CPLQuietErrorHandler);
    CPLErrorReset();
    const GDALDataType type = TypeOf(raster.sample_type);
    const bool is_float = type == GDT_Float32 || type == GDT_Float64;
    const char* const options[] = {"TILED=YES", "COMPRESS=DEFLATE",
                                   is_float ? "PREDICTOR=3" : "PREDICTOR=2", "BIGTIFF=IF_SAFER",
                                   nullptr};
    const GDALDriverH driver = GDALGetDriverByName("GTiff");
    if (driver == nullptr) return Status(StatusCode::kUnsupported, path_ + ": GDAL has no GTiff");
    dataset_ = GDALCreate(driver, temporary_.c_str(), static_cast<int>(raster.columns),
                          static_cast<int>(raster.rows), 1, type, const_cast<char**>(options));
    if (dataset_ == nullptr) return Failed();
    std::array<double, 6> transform = raster.geotransform;
    GDALSetMetadataItem(dataset_, GDALMD_AREA_OR_POINT,
                        raster.is_area ? GDALMD_AOP_AREA : GDALMD_AOP_POINT, nullptr);
    bool good = GDALSetGeoTransform(dataset_, transform.data()) == CE_None;
    if (!raster.crs.empty()) {
      const OGRSpatialReferenceH system = OSRNewSpatialReference(nullptr);
      if (OSRSetFromUserInput(system, raster.crs.c_str()) == OGRERR_NONE) {
        OSRSetAxisMappingStrategy(system, OAMS_TRADITIONAL_GIS_ORDER);
        good = good && GDALSetSpatialRef(dataset_, system) == CE_None;
      } else {
        // What GDAL does not understand travels as a text.
        GDALSetMetadataItem(dataset_, "CRS", raster.crs.c_str(), nullptr);
      }
      OSRDestroySpatialReference(system);
    }
    band_ = GDALGetRasterBand(dataset_, 1);
    nodata_ = raster.nodata;
    if (nodata_) good = good && GDALSetRasterNoDataValue(band_, *nodata_) == CE_None;
    if (!raster.height_units.empty()) GDALSetRasterUnitType(band_, raster.height_units.c_str());
    return good ? Status::Ok() : Failed();
  }

  Status Add(std::span<const double> heights) override {
    row_.assign(heights.begin(), heights.end());
    for (double& h : row_) {
      if (!std::isnan(h)) continue;
      if (!nodata_) return InvalidArgument(path_ + ": a hole, but no value that stands for it");
      h = *nodata_;
    }
    const int columns = static_cast<int>(row_.size());
    if (GDALRasterIO(band_, GF_Write, 0, next_++, columns, 1, row_.data(), columns, 1, GDT_Float64,
                     0, 0) != CE_None) {
      return Failed();
    }
    return Status::Ok();
  }

  Status End() override {
    CPLErrorReset();
    GDALClose(dataset_);
    dataset_ = nullptr;
    if (CPLGetLastErrorType() >= CE_Failure) return Failed();
    MTDB_RETURN_IF_ERROR(CheckReplaceable(path_));
    if (std::rename(temporary_.c_str(), path_.c_str()) != 0) {
      return IoError(path_ + ": " + std::strerror(errno));
    }
    done_ = true;
    return Status::Ok();
  }

 private:
  Status Failed() const { return IoError(path_ + ": " + CPLGetLastErrorMsg()); }

  const std::string path_, temporary_;
  GDALDatasetH dataset_ = nullptr;
  GDALRasterBandH band_ = nullptr;
  std::optional<double> nodata_;
  int next_ = 0;
  bool done_ = false;
  std::vector<double> row_;
};

}  // namespace

Result<std::unique_ptr<GdalWriter>> CreateByGdal(const std::string& path,
                                                 const GdalRaster& raster) {
  auto writer = std::make_unique<GeoTiffWriter>(path);
  MTDB_RETURN_IF_ERROR(writer->Create(raster));
  return std::unique_ptr<GdalWriter>(std::move(writer));
}

}  // namespace mtdb
