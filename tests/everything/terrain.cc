// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/terrain.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "store/base/geometry.h"
#include "tests/everything/process.h"

namespace mtdb::everything {

double Uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }

bool HasGdal() {
  static const bool kThere = MTDB_TEST_GDAL != 0 &&
                             std::system("gdal_translate --version > /dev/null 2>&1") == 0 &&
                             std::system("gdalbuildvrt --version > /dev/null 2>&1") == 0;
  return kThere;
}

std::vector<Terrain::Triangle> Terrain::TrianglesOf(int64_t column, int64_t row) const {
  if (column < 0 || row < 0) return {};
  const auto c = static_cast<uint32_t>(column), r = static_cast<uint32_t>(row);
  const Sample south_west{c, r + 1}, south_east{c + 1, r + 1}, north_west{c, r},
      north_east{c + 1, r};
  const auto has = [&](const Sample& s) { return raster.Has(s[0], s[1]); };
  const bool sw = has(south_west), se = has(south_east), nw = has(north_west), ne = has(north_east);
  std::vector<Triangle> triangles;
  if (sw && se && nw) triangles.push_back({south_west, south_east, north_west});
  if (se && ne && nw) triangles.push_back({south_east, north_east, north_west});
  if (sw && ne && nw && !se) triangles.push_back({south_west, north_east, north_west});
  if (sw && se && ne && !nw) triangles.push_back({south_west, south_east, north_east});
  return triangles;
}

bool Terrain::Covers(int64_t column, int64_t row) const {
  if (!raster.Has(column, row)) return false;
  for (const auto& [dc, dr] : {std::pair{0, 0}, {-1, 0}, {0, -1}, {-1, -1}}) {
    // Three of the four corners of a cell suffice for a triangle.
    if (!TrianglesOf(column + dc, row + dr).empty()) return true;
  }
  return false;
}

bool Terrain::HasSurface() const {
  for (uint32_t r = 0; r + 1 < raster.rows; ++r) {
    for (uint32_t c = 0; c + 1 < raster.columns; ++c) {
      if (!TrianglesOf(c, r).empty()) return true;
    }
  }
  return false;
}

std::vector<double> Terrain::HeightsAt(double x, double y, double slack, bool as_given) const {
  std::vector<double> found;
  const Raster& of = as_given ? given : raster;
  const double u = (x - raster.x0) / raster.cell, v = (raster.y0 - y) / raster.cell;
  std::set<std::array<double, 2>> cells;
  for (const double c : {std::floor(u - slack), std::floor(u + slack)}) {
    for (const double r : {std::floor(v - slack), std::floor(v + slack)}) cells.insert({c, r});
  }
  for (const auto& [c, r] : cells) {
    if (!(c >= -1 && r >= -1 && c < of.columns && r < of.rows)) continue;
    for (const Triangle& t : TrianglesOf(static_cast<int64_t>(c), static_cast<int64_t>(r))) {
      // Barycentric, in cells.
      double share[3];
      bool inside = true;
      for (size_t i = 0; i < 3; ++i) {
        const Sample &a = t[(i + 1) % 3], &b = t[(i + 2) % 3], &p = t[i];
        const auto side = [&](double px, double py) {
          return (static_cast<double>(b[0]) - a[0]) * (py - a[1]) -
                 (static_cast<double>(b[1]) - a[1]) * (px - a[0]);
        };
        share[i] = side(u, v) / side(p[0], p[1]);
        inside = inside && share[i] >= -slack;
      }
      if (!inside) continue;
      double height = 0;
      for (size_t i = 0; i < 3; ++i) height += share[i] * of.At(t[i][0], t[i][1]);
      found.push_back(height);
    }
  }
  return found;
}

double Terrain::ToBorder(double x, double y, const std::array<double, 2>& metres) const {
  double least = std::numeric_limits<double>::infinity();
  const Vec3d p{x * metres[0], y * metres[1], 0};
  for (const auto& e : rim) {
    const double squared = SquaredDistancePointSegment(p, {e[0] * metres[0], e[1] * metres[1], 0},
                                                       {e[2] * metres[0], e[3] * metres[1], 0});
    least = std::min(least, std::sqrt(squared));
  }
  return least;
}

namespace {

// Hills, cliffs and noise; holes alone and in blocks.
void FillTile(const Step& step, std::mt19937_64& random, double decimals, Raster* tile) {
  const double unit = std::pow(10.0, -decimals);
  const double fx = 0.05 + 0.4 * Uniform(random), fy = 0.05 + 0.4 * Uniform(random);
  const double size = std::pow(10.0, 3 * Uniform(random));
  const bool flat = random() % 5 == 0, cliff = random() % 3 == 0;
  for (uint32_t r = 0; r < tile->rows; ++r) {
    for (uint32_t c = 0; c < tile->columns; ++c) {
      double h = flat ? 7 : size * (std::sin(fx * c) + std::cos(fy * r) + 0.1 * Uniform(random));
      if (cliff && c > tile->columns / 2) h += 2 * size;
      tile->At(c, r) = std::round(h / unit) * unit;
    }
  }
  const double share = step.Number("holes", 0);
  for (double& h : tile->heights) {
    if (Uniform(random) < share / 4) h = kHole;
  }
  if (share <= 0) return;
  for (uint64_t n = random() % 3; n > 0; --n) {
    const uint64_t c0 = random() % tile->columns, r0 = random() % tile->rows;
    const uint64_t c1 = std::min<uint64_t>(tile->columns, c0 + 1 + random() % 9);
    const uint64_t r1 = std::min<uint64_t>(tile->rows, r0 + 1 + random() % 9);
    for (uint64_t r = r0; r < r1; ++r) {
      for (uint64_t c = c0; c < c1; ++c) {
        tile->At(static_cast<uint32_t>(c), static_cast<uint32_t>(r)) = kHole;
      }
    }
  }
}

void WriteAscii(const std::string& path, const Raster& tile, int decimals, bool centre) {
  std::ofstream out(path);
  const double south = tile.y0 - tile.cell * (tile.rows - 1);
  const double half = centre ? 0 : tile.cell / 2;
  out << "ncols " << tile.columns << "\nnrows " << tile.rows;
  out << (centre ? "\nxllcenter " : "\nxllcorner ") << NumberText(tile.x0 - half);
  out << (centre ? "\nyllcenter " : "\nyllcorner ") << NumberText(south - half);
  out << "\ncellsize " << NumberText(tile.cell) << "\nNODATA_value -9999\n";
  for (uint32_t r = 0; r < tile.rows; ++r) {
    for (uint32_t c = 0; c < tile.columns; ++c) {
      char text[64];
      const double h = tile.At(c, r);
      std::snprintf(text, sizeof(text), "%.*f", decimals, h);
      out << (c == 0 ? "" : " ") << (std::isnan(h) ? "-9999" : text);
    }
    out << "\n";
  }
}

void WriteHgt(const std::string& path, const Raster& tile) {
  std::string bytes;
  for (const double h : tile.heights) {
    const auto value = static_cast<uint16_t>(static_cast<int16_t>(std::isnan(h) ? -32768 : h));
    bytes += static_cast<char>(value >> 8);
    bytes += static_cast<char>(value & 255);
  }
  WriteText(path, bytes);
}

// By GDAL, of what is there as .asc.
std::string Converted(const std::string& path, bool integers) {
  const std::string tif = path.substr(0, path.size() - 3) + "tif";
  const std::string type = integers ? "Int32" : "Float64";
  const std::string command = "gdal_translate -q -oo DATATYPE=" + type + " -ot " + type + " '" +
                              path + "' '" + tif + "' > /dev/null 2>&1";
  return std::system(command.c_str()) == 0 ? tif : path;
}
// One on top of the other, the first one uppermost.
std::string Stacked(const std::vector<std::string>& files, const std::string& folder) {
  std::string command = "gdalbuildvrt -q '" + folder + "/all.vrt'";
  for (auto f = files.rbegin(); f != files.rend(); ++f) command += " '" + *f + "'";
  return std::system((command + " > /dev/null 2>&1").c_str()) == 0 ? folder + "/all.vrt" : "";
}

// Samples without heights that touch each other by sides or corners.
struct Hole {
  std::vector<Terrain::Sample> samples;
  bool outside = false;  // it reaches the first or last row or column
  uint32_t columns = 0, rows = 0;
};

std::vector<Hole> HolesOf(const Raster& of) {
  std::vector<Hole> holes;
  std::vector<bool> seen(of.heights.size());
  const auto index = [&](const Terrain::Sample& s) { return size_t{s[1]} * of.columns + s[0]; };
  for (uint32_t r = 0; r < of.rows; ++r) {
    for (uint32_t c = 0; c < of.columns; ++c) {
      if (of.Has(c, r) || seen[index({c, r})]) continue;
      Hole hole{{{c, r}}};
      seen[index({c, r})] = true;
      uint32_t left = c, right = c, top = r, bottom = r;
      for (size_t i = 0; i < hole.samples.size(); ++i) {
        const Terrain::Sample s = hole.samples[i];
        left = std::min(left, s[0]), right = std::max(right, s[0]);
        top = std::min(top, s[1]), bottom = std::max(bottom, s[1]);
        for (int k = 0; k < 9; ++k) {
          const Terrain::Sample next{s[0] + static_cast<uint32_t>(k % 3) - 1,
                                     s[1] + static_cast<uint32_t>(k / 3) - 1};
          if (next[0] >= of.columns || next[1] >= of.rows) continue;
          if (of.Has(next[0], next[1]) || seen[index(next)]) continue;
          seen[index(next)] = true;
          hole.samples.push_back(next);
        }
      }
      hole.outside = left == 0 || top == 0 || right + 1 == of.columns || bottom + 1 == of.rows;
      hole.columns = right - left + 1, hole.rows = bottom - top + 1;
      holes.push_back(std::move(hole));
    }
  }
  return holes;
}

// Each height is the mean of the four beside it.
void Fill(const Hole& hole, Raster* of) {
  for (const auto& s : hole.samples) of->At(s[0], s[1]) = 0;
  for (int round = 0; round < 20000; ++round) {
    double most = 0;
    for (const auto& [c, r] : hole.samples) {
      const double mean =
          (of->At(c - 1, r) + of->At(c + 1, r) + of->At(c, r - 1) + of->At(c, r + 1)) / 4;
      most = std::max(most, std::abs(mean - of->At(c, r)));
      of->At(c, r) = mean;
    }
    if (most < 1e-9) break;
  }
}

void FindRim(Terrain* terrain) {
  std::map<std::pair<Terrain::Sample, Terrain::Sample>, int> edges;
  const Raster& all = terrain->raster;
  for (uint32_t r = 0; r + 1 < all.rows; ++r) {
    for (uint32_t c = 0; c + 1 < all.columns; ++c) {
      for (const Terrain::Triangle& t : terrain->TrianglesOf(c, r)) {
        for (size_t i = 0; i < 3; ++i) ++edges[std::minmax(t[i], t[(i + 1) % 3])];
      }
    }
  }
  for (const auto& [edge, triangles] : edges) {
    const auto& [a, b] = edge;
    if (triangles == 1) {
      terrain->rim.push_back({terrain->X(a), terrain->Y(a), terrain->X(b), terrain->Y(b)});
    }
  }
}

}  // namespace

Terrain MakeTerrain(const Step& step, const std::string& folder) {
  std::mt19937_64 random(static_cast<uint64_t>(step.Int("seed", 1)));
  const std::string format = step.Text("format", "asc");
  const bool hgt = format == "hgt";
  const int decimals =
      hgt ? 0 : static_cast<int>(std::clamp<int64_t>(step.Int("decimals", 0), 0, 4));
  const auto columns = static_cast<uint32_t>(std::clamp<int64_t>(step.Int("columns", 5), 2, 300));
  const auto rows =
      hgt ? columns : static_cast<uint32_t>(std::clamp<int64_t>(step.Int("rows", 5), 1, 300));
  const int64_t tiles = std::clamp<int64_t>(step.Int("tiles", 1), 1, 4);
  const uint32_t apart = columns - (hgt || step.Flag("overlap") ? 1 : 0);
  Terrain terrain;
  Raster& all = terrain.raster;
  all.columns = columns + static_cast<uint32_t>(tiles - 1) * apart;
  all.rows = rows;
  all.cell = hgt ? 1.0 / (columns - 1) : step.Number("cell", 1);
  all.x0 = hgt ? 7 : step.Number("x", 0);
  all.y0 = hgt ? 47 : step.Number("y", 0);
  // Where doubles tell a sample from the next one, and from a millionth beside it.
  if (!hgt) all.cell = std::max(all.cell, 1e-7 * std::max(std::abs(all.x0), std::abs(all.y0)));
  all.heights.assign(size_t{all.columns} * all.rows, kHole);
  for (int64_t t = 0; t < tiles; ++t) {
    Raster tile = all;
    tile.columns = columns;
    tile.x0 = all.x0 + static_cast<double>(t * apart) * all.cell;
    tile.heights.assign(size_t{columns} * rows, 0);
    FillTile(step, random, decimals, &tile);
    std::string file = folder + "/t" + std::to_string(t) + ".asc";
    if (hgt) {
      file = folder + "/N46E00" + std::to_string(7 + t) + ".hgt";
      WriteHgt(file, tile);
    } else {
      WriteAscii(file, tile, decimals, step.Flag("centre"));
    }
    // The first file's samples stay.
    const bool last_wins = step.Flag("order");
    for (uint32_t r = 0; r < rows; ++r) {
      for (uint32_t c = 0; c < columns; ++c) {
        double& h = all.At(c + static_cast<uint32_t>(t) * apart, r);
        const double mine = tile.At(c, r);
        if (!std::isnan(mine) && (std::isnan(h) || last_wins)) h = mine;
      }
    }
    terrain.files.insert(last_wins ? terrain.files.begin() : terrain.files.end(), file);
  }
  const bool gdal = (format == "tif" || format == "vrt") && HasGdal();
  if (gdal) {
    for (std::string& file : terrain.files) file = Converted(file, decimals == 0);
    const std::string stacked = format == "vrt" ? Stacked(terrain.files, folder) : "";
    if (!stacked.empty()) terrain.files = {stacked};
  }
  if (step.has("step-z")) {
    terrain.step_z = step.Text("step-z");
  } else if (gdal && decimals > 0) {
    terrain.step_z = NumberText(std::pow(10.0, -decimals));  // heights are floats there
  }
  const auto fill = static_cast<uint32_t>(std::clamp<int64_t>(step.Int("fill", 0), 0, 1000));
  for (const Hole& hole : HolesOf(all)) {
    if (fill == 0 || hole.outside) continue;
    if (std::max(hole.columns, hole.rows) > fill) {
      ++terrain.larger_holes;
      continue;
    }
    Fill(hole, &all);
    terrain.filled.insert(terrain.filled.end(), hole.samples.begin(), hole.samples.end());
  }
  terrain.given = all;
  const double coarse = std::strtod(terrain.step_z.c_str(), nullptr);
  terrain.lowest = std::numeric_limits<double>::infinity();
  terrain.highest = -terrain.lowest;
  for (double& h : all.heights) {
    if (std::isnan(h)) continue;
    const double before = h;
    if (coarse > 0) h = coarse * std::floor(h / coarse + 0.5);
    terrain.rounding = std::max(terrain.rounding, std::abs(h - before));
    terrain.lowest = std::min(terrain.lowest, h);
    terrain.highest = std::max(terrain.highest, h);
  }
  terrain.tolerance = 1e-8 * (1 + std::max(std::abs(terrain.lowest), std::abs(terrain.highest)));
  terrain.has_holes = std::ranges::any_of(all.heights, [](double h) { return std::isnan(h); });
  FindRim(&terrain);
  return terrain;
}

// What `extract` wrote; without rows: it cannot be read.
Raster ReadAscii(const std::string& path) {
  std::ifstream in(path);
  std::map<std::string, double> header;
  Raster raster;
  std::string word;
  for (int i = 0; i < 6 && in >> word; ++i) in >> header[word];
  raster.columns = static_cast<uint32_t>(header["ncols"]);
  raster.rows = static_cast<uint32_t>(header["nrows"]);
  raster.cell = header["cellsize"];
  raster.x0 = header["xllcenter"];
  raster.y0 = header["yllcenter"] + raster.cell * (raster.rows - 1);
  for (double h = 0; in >> h;) raster.heights.push_back(h == header["NODATA_value"] ? kHole : h);
  if (raster.heights.size() != size_t{raster.columns} * raster.rows) raster.rows = 0;
  return raster;
}

}  // namespace mtdb::everything
