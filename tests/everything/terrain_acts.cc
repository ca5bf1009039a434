// SPDX-License-Identifier: Apache-2.0
// Terrains: small rasters with holes, joined, stored, killed and resumed, and asked in every way
// that heights can be asked; each answer is held against the samples.
//
// Parameters of a step: seed; format asc or hgt; columns, rows, tiles (from west to east), overlap,
// order (the last file is given first), holes (share), decimals, cell, x, y, step-z; error (of the
// heights' range); operation (at which the ingest is killed, before one that resumes), threads,
// tmp.
#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <random>
#include <sstream>

#include "tests/everything/world.h"
#include "tests/support/file_server.h"
#include "tests/support/read_mesh.h"

namespace mtdb::everything {

namespace fs = std::filesystem;

namespace {

constexpr double kHole = std::numeric_limits<double>::quiet_NaN();

// Samples as they lie: rows from north to south.
struct Raster {
  uint32_t columns = 0, rows = 0;
  double cell = 1;
  double x0 = 0, y0 = 0;  // of the first sample, in the north-west
  std::vector<double> heights;

  double& At(uint32_t column, uint32_t row) { return heights[size_t{row} * columns + column]; }
  double At(uint32_t column, uint32_t row) const { return heights[size_t{row} * columns + column]; }
  bool Has(int64_t column, int64_t row) const {
    return column >= 0 && row >= 0 && column < columns && row < rows &&
           !std::isnan(At(static_cast<uint32_t>(column), static_cast<uint32_t>(row)));
  }
};

struct Terrain {
  Raster raster;  // the files joined, heights as they are stored
  Raster given;   // likewise as the files have them
  std::vector<std::string> files;
  double rounding = 0;  // that --step-z made
  double lowest = 0, highest = 0;
  double tolerance = 0;  // of what is written as text

  // South-west, south-east, north-west, north-east of a cell: which have a height.
  int Corners(int64_t column, int64_t row) const {
    return (raster.Has(column, row + 1) ? 1 : 0) | (raster.Has(column + 1, row + 1) ? 2 : 0) |
           (raster.Has(column, row) ? 4 : 0) | (raster.Has(column + 1, row) ? 8 : 0);
  }
  bool HasTriangle(int64_t column, int64_t row) const {
    return __builtin_popcount(static_cast<unsigned>(Corners(column, row))) >= 3;
  }
  // A sample of which no triangle is a corner is no part of the surface.
  bool Covers(int64_t column, int64_t row) const {
    if (!raster.Has(column, row)) return false;
    for (const auto& [dc, dr] : {std::pair{0, 0}, {-1, 0}, {0, -1}, {-1, -1}}) {
      const int64_t c = column + dc, r = row + dr;
      if (c >= 0 && r >= 0 && HasTriangle(c, r)) return true;
    }
    return false;
  }
  bool HasSurface() const {
    for (uint32_t row = 0; row + 1 < raster.rows; ++row) {
      for (uint32_t c = 0; c + 1 < raster.columns; ++c) {
        if (HasTriangle(c, row)) return true;
      }
    }
    return false;
  }

  // Heights of the surface at a place, of all cells that it touches within `slack` of a cell: as it
  // is stored, or as it was given.
  std::vector<double> HeightsAt(double x, double y, double slack, bool as_given) const {
    std::vector<double> found;
    const double u = (x - raster.x0) / raster.cell, v = (raster.y0 - y) / raster.cell;
    for (const double c : {std::floor(u - slack), std::floor(u + slack)}) {
      for (const double r : {std::floor(v - slack), std::floor(v + slack)}) {
        AddHeights(as_given ? given : raster, static_cast<int64_t>(c), static_cast<int64_t>(r),
                   u - c, 1 - (v - r), slack, &found);
      }
    }
    return found;
  }

 private:
  // East and north within the cell. Its diagonal runs from south-east to north-west, unless one of
  // these has no height.
  void AddHeights(const Raster& of, int64_t c, int64_t r, double east, double north, double slack,
                  std::vector<double>* found) const {
    if (c < 0 || r < 0) return;
    const int corners = Corners(c, r);
    const auto z = [&](int dc, int dr) {
      return of.At(static_cast<uint32_t>(c + dc), static_cast<uint32_t>(r + dr));
    };
    constexpr int kSouthWest = 1, kSouthEast = 2, kNorthWest = 4, kNorthEast = 8;
    const auto has = [&](int needed) { return (corners & needed) == needed; };
    if (has(kSouthWest | kSouthEast | kNorthWest) && east + north <= 1 + slack) {
      found->push_back(z(0, 1) + east * (z(1, 1) - z(0, 1)) + north * (z(0, 0) - z(0, 1)));
    }
    if (has(kSouthEast | kNorthWest | kNorthEast) && east + north >= 1 - slack) {
      found->push_back(z(1, 0) + (1 - east) * (z(0, 0) - z(1, 0)) +
                       (1 - north) * (z(1, 1) - z(1, 0)));
    }
    if (corners == (kSouthWest | kNorthWest | kNorthEast) && north >= east - slack) {
      found->push_back(z(0, 1) + north * (z(0, 0) - z(0, 1)) + east * (z(1, 0) - z(0, 0)));
    }
    if (corners == (kSouthWest | kSouthEast | kNorthEast) && east >= north - slack) {
      found->push_back(z(0, 1) + east * (z(1, 1) - z(0, 1)) + north * (z(1, 0) - z(1, 1)));
    }
  }
};

double Uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }

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

Terrain MakeTerrain(const Step& step, const std::string& folder) {
  std::mt19937_64 random(static_cast<uint64_t>(step.Int("seed", 1)));
  const bool hgt = step.Text("format", "asc") == "hgt";
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
  terrain.given = all;
  const double coarse = step.Number("step-z", 0);
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

class TerrainWalk {
 public:
  TerrainWalk(World& world, const Step& step)
      : world_(world),
        step_(step),
        folder_(NewFolder(world)),
        terrain_(MakeTerrain(step, folder_)) {}

  void Run() {
    if (!Ingest() || world_.stopped()) return;
    const double error = step_.Number("error", 0.05) * (terrain_.highest - terrain_.lowest);
    for (const std::string& place : Places()) {
      world_.Note("terrain: " + place);
      CheckRaster(place, -1);
      CheckRaster(place, error);
      CheckMesh(place, error);
      CheckProbes(place, -1);
      CheckProbes(place, error);
      CheckProfile(place, error);
    }
    CheckServer(error);
  }

 private:
  static std::string NewFolder(World& world) {
    static int next = 0;
    const std::string folder = world.Folder("terrain" + std::to_string(next++));
    fs::create_directories(folder);
    return folder;
  }
  std::string File(const std::string& name) const { return folder_ + "/" + name; }

  // False: there is nothing to ask.
  bool Ingest() {
    Arguments arguments{"ingest", "--json", "--name=t"};
    if (step_.has("step-z")) arguments.push_back("--step-z=" + step_.Text("step-z"));
    if (step_.has("threads")) arguments.push_back("--threads=" + step_.Text("threads"));
    if (step_.Flag("tmp")) arguments.push_back("--tmp=" + world_.Folder("tmp"));
    arguments.insert(arguments.end(), terrain_.files.begin(), terrain_.files.end());
    arguments.push_back(File("s.mtdb"));
    ++world_.counts().acts;
    bool killed = false;
    if (step_.has("operation")) {
      killed = RunOrKill(world_, step_, arguments).killed;
      if (killed) arguments.insert(arguments.begin() + 1, "--resume");
    }
    if (!killed && step_.has("operation")) arguments.insert(arguments.begin() + 1, "--force");
    const Ran ran = world_.Mtdb(arguments);
    const bool fits = terrain_.HasSurface();
    if (ran.ok() != fits) {
      world_.ErrorFault(fits ? "terrain: refused" : "terrain: not refused", ran.err);
      return false;
    }
    if (!fits) return false;
    if (killed) CompareWithOther(arguments);
    for (const auto& entry : fs::directory_iterator(folder_)) {
      const std::string name = entry.path().filename().string();
      if (!name.ends_with(".asc") && !name.ends_with(".hgt") && !name.starts_with("s.mtdb") &&
          !name.starts_with("other.mtdb")) {
        world_.ErrorFault("terrain: left behind", name);
      }
      if (name.ends_with(".journal")) world_.ErrorFault("terrain: left behind", name);
    }
    const Ran verify = world_.Mtdb({"verify", File("s.mtdb"), "--level", "global"});
    if (!verify.ok()) world_.ErrorFault("terrain: verify", verify.out + verify.err);
    return true;
  }

  // An ingest that went on gives what one gives that was not disturbed.
  void CompareWithOther(Arguments arguments) {
    arguments.erase(arguments.begin() + 1);
    arguments.back() = File("other.mtdb");
    const Ran ran = world_.Mtdb(arguments);
    if (!ran.ok()) return world_.ErrorFault("terrain: refused", ran.err);
    const auto mine = ReadRecord(File("s.mtdb"), "t"), other = ReadRecord(File("other.mtdb"), "t");
    if (!mine.ok() || !other.ok() || mine->digest_hex() != other->digest_hex()) {
      world_.Fault("terrain: another object after --resume", "");
    }
  }

  // The store, a copy of it, a packed file.
  std::vector<std::string> Places() {
    std::vector<std::string> places{File("s.mtdb")};
    const uint64_t which = static_cast<uint64_t>(step_.Int("seed", 1)) % 3;
    if (which == 1) {
      const Ran ran = world_.Mtdb({"copy", places[0], File("copy.mtdb")});
      if (!ran.ok()) world_.ErrorFault("terrain: copy", ran.err);
      places.push_back(File("copy.mtdb"));
    } else if (which == 2) {
      const Ran ran = world_.Mtdb({"pack", places[0], File("p.mtdbp")});
      if (!ran.ok()) world_.ErrorFault("terrain: pack", ran.err);
      places.push_back(File("p.mtdbp"));
    }
    return places;
  }

  Arguments WithError(Arguments arguments, double error) const {
    if (error >= 0) arguments.push_back("--error=" + NumberText(error));
    return arguments;
  }
  std::optional<nlohmann::json> Asked(const std::string& what, const Arguments& arguments) {
    ++world_.counts().answers;
    const Ran ran = world_.Mtdb(arguments);
    auto json = nlohmann::json::parse(ran.out, nullptr, false);
    if (ran.ok() && json.is_object()) return json;
    world_.ErrorFault("terrain: " + what + " is refused", ran.err);
    return std::nullopt;
  }
  // What may be off, when it says so; at full resolution nothing.
  double Slack(double error, double bound) const {
    return (error < 0 ? 0 : bound * (1 + 1e-9)) + terrain_.tolerance;
  }
  void CheckBound(const std::string& what, double error, double bound) {
    // What was rounded cannot be had back.
    const double best = std::max({error, 0.0, terrain_.rounding + terrain_.tolerance});
    if (bound > best * (1 + 1e-9)) {
      world_.Fault("terrain: " + what + ": bound above the requested error",
                   NumberText(bound) + " of " + NumberText(error));
    }
  }

  void CheckRaster(const std::string& place, double error) {
    const std::string out = File("out.asc");
    const auto json = Asked("extract", WithError({"extract", place, out, "--json"}, error));
    if (!json) return;
    const double bound = json->at("error_bound");
    CheckBound("raster", error, bound);
    const Raster got = ReadAscii(out);
    const Raster& all = terrain_.raster;
    if (got.columns != all.columns || got.rows != all.rows ||
        std::abs(got.x0 - all.x0) > 1e-6 * all.cell ||
        std::abs(got.y0 - all.y0) > 1e-6 * all.cell) {
      return world_.Fault("terrain: a raster lies elsewhere", out);
    }
    for (uint32_t r = 0; r < all.rows; ++r) {
      for (uint32_t c = 0; c < all.columns; ++c) {
        const bool covered = terrain_.Covers(c, r);
        const double right = (error < 0 ? all : terrain_.given).At(c, r);
        const std::string where = "column " + std::to_string(c) + ", row " + std::to_string(r) +
                                  ": " + NumberText(got.At(c, r)) + " of " + NumberText(right);
        if (covered == std::isnan(got.At(c, r))) {
          return world_.Fault(
              covered ? "terrain: a sample is lost" : "terrain: a hole has a height", where);
        }
        if (covered && !(std::abs(got.At(c, r) - right) <= Slack(error, bound))) {
          return world_.Fault("terrain: a sample is off by more than the bound", where);
        }
      }
    }
  }

  // Its vertices are samples.
  void CheckMesh(const std::string& place, double error) {
    const std::string out = File("out.ply");
    const auto json = Asked("extract", WithError({"extract", place, out, "--json"}, error));
    if (!json) return;
    CheckBound("mesh", error, json->at("error_bound"));
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    MeshReadReport report;
    const Status read = ReadMeshFile(out, sink, &report);
    if (!read.ok()) return world_.ErrorFault("terrain: mesh", read.message());
    for (const Vec3d& p : mesh.positions) {
      const double u = (p.x - terrain_.raster.x0) / terrain_.raster.cell;
      const double v = (terrain_.raster.y0 - p.y) / terrain_.raster.cell;
      const auto c = static_cast<int64_t>(std::llround(u)),
                 r = static_cast<int64_t>(std::llround(v));
      if (std::abs(u - static_cast<double>(c)) < 1e-5 &&
          std::abs(v - static_cast<double>(r)) < 1e-5 && terrain_.Covers(c, r) &&
          std::abs(p.z - terrain_.raster.At(static_cast<uint32_t>(c), static_cast<uint32_t>(r))) <=
              terrain_.tolerance) {
        continue;
      }
      return world_.Fault("terrain: a vertex is no sample",
                          NumberText(p.x) + " " + NumberText(p.y) + " " + NumberText(p.z));
    }
  }

  // Whether a height at a place is one of the surface's, give or take `slack`.
  void CheckHeight(const std::string& what, double x, double y, const nlohmann::json& height,
                   double slack, bool as_given) {
    constexpr double kTouch = 1e-6;  // of a cell
    const std::vector<double> right = terrain_.HeightsAt(x, y, kTouch, as_given);
    const std::string where = NumberText(x) + "," + NumberText(y) + ": " + height.dump();
    if (height.is_null()) {
      // On a border either is right.
      if (!right.empty() && terrain_.HeightsAt(x, y, -kTouch, as_given).size() == right.size()) {
        world_.Fault("terrain: " + what + " finds a hole", where);
      }
      return;
    }
    if (right.empty()) return world_.Fault("terrain: " + what + " finds a height in a hole", where);
    const double steepness = kTouch * 10 * (terrain_.highest - terrain_.lowest);
    const double found = height;
    for (const double h : right) {
      if (std::abs(found - h) <= slack + steepness) return;
    }
    world_.Fault("terrain: " + what + " is off by more than the bound",
                 where + " of " + NumberText(right[0]) + ", give or take " + NumberText(slack));
  }

  void CheckProbes(const std::string& place, double error) {
    std::mt19937_64 random(static_cast<uint64_t>(step_.Int("seed", 1)) + 99);
    const Raster& all = terrain_.raster;
    std::string places;
    for (int i = 0; i < 40; ++i) {
      double u = -1 + (all.columns + 1) * Uniform(random),
             v = -1 + (all.rows + 1) * Uniform(random);
      if (i % 3 == 0) u = std::round(u), v = std::round(v);
      if (i % 7 == 0) v = std::round(v);
      places += NumberText(all.x0 + u * all.cell) + " " + NumberText(all.y0 - v * all.cell) + "\n";
    }
    WriteText(File("places"), places);
    const auto json =
        Asked("probe", WithError({"probe", place, "--heights", File("places"), "--json"}, error));
    fs::remove(File("places"));
    if (!json) return;
    for (const auto& h : json->at("heights")) {
      const double bound = h.at("error_bound");
      CheckBound("probe", error, bound);
      CheckHeight("probe", h.at("x"), h.at("y"), h.at("height"), Slack(error, bound), error >= 0);
    }
  }

  void CheckProfile(const std::string& place, double error) {
    std::mt19937_64 random(static_cast<uint64_t>(step_.Int("seed", 1)) + 7);
    const Raster& all = terrain_.raster;
    std::string line;
    for (uint64_t i = 2 + random() % 3; i > 0; --i) {
      const double u = -1 + (all.columns + 1) * Uniform(random);
      const double v = -1 + (all.rows + 1) * Uniform(random);
      line += (line.empty() ? "" : ",") + NumberText(all.x0 + u * all.cell) + "," +
              NumberText(all.y0 - v * all.cell);
    }
    const auto json =
        Asked("profile", WithError({"profile", place, "--line=" + line, "--json"}, error));
    if (!json) return;
    const double bound = json->at("error_bound");
    CheckBound("profile", error, bound);
    double before = 0;
    for (const auto& p : json->at("points")) {
      if (p.at("distance") < before) world_.Fault("terrain: profile goes back", p.dump());
      before = p.at("distance");
      // A null says that a gap begins there.
      if (p.at("height").is_null()) continue;
      CheckHeight("profile", p.at("x"), p.at("y"), p.at("height"), Slack(error, bound), error >= 0);
    }
  }

  // A mesh from a server is the one that extract writes.
  void CheckServer(double error) {
    const std::string here = File("here.ply"), there = File("there.ply");
    const auto mine =
        Asked("extract", WithError({"extract", File("s.mtdb"), here, "--json"}, error));
    const Server server(world_.options(), File("s.mtdb"));
    if (server.url().empty()) return world_.ErrorFault("terrain: serve", server.errors());
    const auto theirs = Asked(
        "fetch",
        WithError({"fetch", server.url() + "/objects/t", there, "--json", "--timeout=900"}, error));
    if (mine && theirs && ReadText(here) != ReadText(there)) {
      world_.Fault("terrain: fetch brings another mesh", "");
    }
  }

  World& world_;
  const Step& step_;
  const std::string folder_;
  const Terrain terrain_;
};

}  // namespace

void TerrainAct(World& world, const Step& step) { TerrainWalk(world, step).Run(); }

}  // namespace mtdb::everything
