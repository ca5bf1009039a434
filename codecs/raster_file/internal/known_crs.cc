// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "codecs/raster_file/internal/readers.h"

namespace mtdb::internal {

namespace {

struct Datum {
  const char* name;
  const char* datum;
  const char* ellipsoid;  // name, semi-major axis, inverse flattening
  int geographic;         // EPSG
  int utm_north;          // EPSG of zone 0
};
constexpr Datum kDatums[] = {
    {"NAD27", "North American Datum 1927", "\"Clarke 1866\",6378206.4,294.978698213898", 4267,
     26700},
    {"WGS 72", "World Geodetic System 1972", "\"WGS 72\",6378135,298.26", 4322, 32200},
    {"WGS 84", "World Geodetic System 1984", "\"WGS 84\",6378137,298.257223563", 4326, 32600},
    {"NAD83", "North American Datum 1983", "\"GRS 1980\",6378137,298.257222101", 4269, 26900},
};
constexpr const char* kDegree = "ANGLEUNIT[\"degree\",0.0174532925199433]";

std::string DatumWkt(const Datum& d) {
  return std::string("DATUM[\"") + d.datum + "\",ELLIPSOID[" + d.ellipsoid +
         ",LENGTHUNIT[\"metre\",1]]],PRIMEM[\"Greenwich\",0," + kDegree + "]";
}

}  // namespace

std::string Wgs84Wkt() {
  const std::string degree = kDegree;
  return "GEOGCRS[\"WGS 84\"," + DatumWkt(kDatums[2]) +
         ",CS[ellipsoidal,2],AXIS[\"geodetic latitude (Lat)\",north,ORDER[1]," + degree +
         "],AXIS[\"geodetic longitude (Lon)\",east,ORDER[2]," + degree + "],ID[\"EPSG\",4326]]";
}

std::string UtmWkt(int zone, int datum) {
  const int number = zone < 0 ? -zone : zone;
  if (number < 1 || number > 60 || datum < 1 || datum > 4) return "";
  const Datum& d = kDatums[datum - 1];
  char text[2000];
  const char* const metre = "LENGTHUNIT[\"metre\",1]";
  std::snprintf(
      text, sizeof(text),
      "PROJCRS[\"%s / UTM zone %d%c\",BASEGEOGCRS[\"%s\",%s,ID[\"EPSG\",%d]],CONVERSION[\"UTM "
      "zone %d%c\",METHOD[\"Transverse Mercator\",ID[\"EPSG\",9807]],PARAMETER[\"Latitude of "
      "natural origin\",0,%s],PARAMETER[\"Longitude of natural origin\",%d,%s],PARAMETER[\"Scale "
      "factor at natural origin\",0.9996,SCALEUNIT[\"unity\",1]],PARAMETER[\"False "
      "easting\",500000,%s],PARAMETER[\"False northing\",%d,%s]],CS[Cartesian,2],AXIS[\"(E)\","
      "east,ORDER[1],%s],AXIS[\"(N)\",north,ORDER[2],%s]%s]",
      d.name, number, zone < 0 ? 'S' : 'N', d.name, DatumWkt(d).c_str(), d.geographic, number,
      zone < 0 ? 'S' : 'N', kDegree, 6 * number - 183, kDegree, metre, zone < 0 ? 10000000 : 0,
      metre, metre, metre,
      zone > 0 ? (",ID[\"EPSG\"," + std::to_string(d.utm_north + number) + "]").c_str() : "");
  return text;
}

}  // namespace mtdb::internal
