// SPDX-License-Identifier: Apache-2.0
// The places of a comparison in files: as a table, as a query, as GeoJSON.
#pragma once

#include <optional>
#include <string>

#include "query/compare.h"
#include "store/base/status.h"

namespace mtdb {

// A row for each place.
Status WritePlacesCsv(const std::string& path, const Comparison& found);

// A query for what lies in the boxes of the places, as extract --query takes it, the farthest
// first. Without places there is no region, and nothing is written.
Status WritePlacesQuery(const std::string& path, const Comparison& found);

// The code of the EPSG data set for a coordinate reference system, of "EPSG:25832", or WKT that
// ends with it; none: there is no such code.
std::optional<int> EpsgCodeOf(const std::string& georeference);

// A polygon for each place: the footprint of its box, in the coordinates of A. RFC 7946 wants
// longitudes and latitudes in WGS 84: where they are such, the file has nothing else. Where they
// are known to be others, it has the member "crs" of the format of 2008, which GDAL and QGIS read.
// Else they are written all the same, and `note` says that a reader takes them for degrees.
Status WritePlacesGeoJson(const std::string& path, const std::string& georeference,
                          const Comparison& found, std::string* note);

}  // namespace mtdb
