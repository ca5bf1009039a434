// SPDX-License-Identifier: Apache-2.0
// Terrains: small rasters with holes, joined, filled, stored, killed and resumed, and asked in
// every way that heights can be asked; each answer is held against the samples. Then the same
// surface once more, as a mesh that becomes a terrain, and as an array by the C functions.
//
// Parameters of a step: seed; format asc, hgt, tif or vrt; columns, rows, tiles (from west to
// east), overlap, order (the last file is given first), holes (share), decimals, cell, x, y,
// step-z, fill; error (of the heights' range); operation (at which the ingest is killed, before one
// that resumes), threads, tmp; mesh, c, drape, picture (do that, too).
#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "tests/everything/terrain.h"
#include "tests/everything/world.h"
#include "tests/support/file_server.h"
#include "tests/support/read_mesh.h"
#include "tools/c/mtdb_terrain.h"

namespace mtdb::everything {

namespace fs = std::filesystem;

namespace {

class TerrainWalk {
 public:
  TerrainWalk(World& world, const Step& step)
      : world_(world),
        step_(step),
        folder_(NewFolder(world)),
        terrain_(MakeTerrain(step, folder_)) {}

  void Run() {
    if (!Ingest() || !AdoptFilled() || world_.stopped()) return;
    const double error = step_.Number("error", 0.05) * (terrain_.highest - terrain_.lowest);
    const std::vector<std::string> places = Places();
    for (const std::string& place : places) {
      world_.Note("terrain: " + place);
      CheckRaster(place, -1);
      CheckRaster(place, error);
      CheckMesh(place, error);
      CheckLines(place, -1);
      CheckLines(place, error);
    }
    CheckServer(error);
    if (step_.Flag("picture")) CheckPictures(places, error);
    if (step_.Flag("drape")) CheckDrape(places.back(), error);
    // Last: what is asked then are other objects.
    if (step_.Flag("c")) CheckC(error);
    if (step_.Flag("mesh")) CheckAsMesh(error);
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
    if (!terrain_.step_z.empty()) arguments.push_back("--height-step=" + terrain_.step_z);
    if (step_.has("fill")) {
      arguments.push_back("--fill=" + std::to_string(std::max<int64_t>(1, step_.Int("fill", 1))));
    }
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
    if (!killed && step_.has("operation")) arguments.insert(arguments.begin() + 1, "--replace");
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
      const bool mine = std::ranges::any_of(
          std::initializer_list<const char*>{".asc", ".hgt", ".tif", ".vrt", ".xml"},
          [&](const char* end) { return name.ends_with(end); });
      if (!mine && !name.starts_with("s.mtdb") && !name.starts_with("other.mtdb")) {
        world_.ErrorFault("terrain: left behind", name);
      }
      if (name.ends_with(".journal")) world_.ErrorFault("terrain: left behind", name);
    }
    Learn(ran.out);
    const Ran verify = world_.Mtdb({"verify", File("s.mtdb"), "--level", "global"});
    if (!verify.ok()) world_.ErrorFault("terrain: verify", verify.out + verify.err);
    return true;
  }

  // What the ingest tells of its object.
  void Learn(const std::string& text) {
    const auto json = nlohmann::json::parse(text, nullptr, false);
    if (!json.is_object()) return world_.ErrorFault("terrain: no JSON", text);
    step_size_ = json.value("step", 0.0);
    rounding_ = terrain_.rounding;
    const auto raster = json.find("raster");
    if (raster == json.end()) return;
    metres_ = raster->at("metres_of_unit");
    const auto& input = json.at("raster_input");
    if (input.at("filled") != terrain_.filled.size() ||
        input.at("larger_holes") != (step_.has("fill") ? terrain_.larger_holes : 0)) {
      world_.Fault("terrain: other holes are filled",
                   input.dump() + ", not " + std::to_string(terrain_.filled.size()) +
                       " samples, and but " + std::to_string(terrain_.larger_holes) + " holes");
    }
  }

  // The heights of samples that ingest filled, which are the model's, rounded.
  bool AdoptFilled() {
    if (terrain_.filled.empty()) return true;
    const std::string out = File("filled.asc");
    if (!Asked("extract", {"extract", File("s.mtdb"), out, "--json"})) return false;
    const Raster got = ReadAscii(out);
    if (got.heights.size() != terrain_.raster.heights.size()) {
      world_.Fault("terrain: a raster lies elsewhere", out);
      return false;
    }
    const double most = (terrain_.step_z.empty() ? 0.51 : 1.02) * step_size_ + terrain_.tolerance;
    for (const auto& [c, r] : terrain_.filled) {
      const double right = terrain_.given.At(c, r), found = got.At(c, r);
      // A sample between holes may be a corner of no triangle.
      if (!terrain_.Covers(c, r)) continue;
      if (!(std::abs(found - right) <= most)) {
        world_.Fault("terrain: a hole is filled otherwise",
                     NumberText(found) + " of " + NumberText(right));
        return false;
      }
      terrain_.raster.At(c, r) = terrain_.given.At(c, r) = found;
    }
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
    return (error < 0 && exact_ ? 0 : bound * (1 + 1e-9)) + terrain_.tolerance;
  }
  // Where borders move, places within the bound of one may be outside.
  bool MayBeLost(double x, double y, double error, double bound) const {
    if (exact_ && (error < 0 || !terrain_.has_holes)) return false;
    return terrain_.ToBorder(x, y, metres_) <= bound * (1 + 1e-6) + 1e-6 * terrain_.raster.cell;
  }
  void CheckBound(const std::string& what, double error, double bound) {
    // What was rounded cannot be had back.
    const double best = std::max({error, 0.0, rounding_ + terrain_.tolerance});
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
    CompareSamples("a raster", got, error, bound);
  }

  void CompareSamples(const std::string& what, const Raster& got, double error, double bound) {
    const Raster& all = terrain_.raster;
    for (uint32_t r = 0; r < all.rows; ++r) {
      for (uint32_t c = 0; c < all.columns; ++c) {
        const bool covered = terrain_.Covers(c, r);
        const double right = (error < 0 ? all : terrain_.given).At(c, r);
        const std::string where = "column " + std::to_string(c) + ", row " + std::to_string(r) +
                                  ": " + NumberText(got.At(c, r)) + " of " + NumberText(right);
        if (covered && std::isnan(got.At(c, r)) &&
            MayBeLost(terrain_.X({c, r}), terrain_.Y({c, r}), error, bound)) {
          continue;
        }
        if (covered == std::isnan(got.At(c, r))) {
          return world_.Fault(
              "terrain: " + what + (covered ? ": a sample is lost" : ": a hole has a height"),
              where);
        }
        if (covered && !(std::abs(got.At(c, r) - right) <= Slack(error, bound))) {
          return world_.Fault("terrain: " + what + ": a sample is off by more than the bound",
                              where);
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
                   double error, double bound) {
    const double slack = Slack(error, bound);
    const bool as_given = error >= 0;
    constexpr double kTouch = 1e-6;  // of a cell
    const std::vector<double> right = terrain_.HeightsAt(x, y, kTouch, as_given);
    const std::string where = NumberText(x) + "," + NumberText(y) + ": " + height.dump();
    if (height.is_null()) {
      // On a border either is right.
      if (!right.empty() && !MayBeLost(x, y, error, bound) &&
          terrain_.HeightsAt(x, y, -kTouch, as_given).size() == right.size()) {
        world_.Fault("terrain: " + what + " finds a hole", where);
      }
      return;
    }
    if (right.empty()) {
      // Positions of a mesh are rounded.
      if (!exact_ && terrain_.ToBorder(x, y, metres_) <= bound + step_size_) return;
      return world_.Fault("terrain: " + what + " finds a height in a hole", where);
    }
    const double steepness = kTouch * 10 * (terrain_.highest - terrain_.lowest);
    const double found = height;
    for (const double h : right) {
      if (std::abs(found - h) <= slack + steepness) return;
    }
    world_.Fault("terrain: " + what + " is off by more than the bound",
                 where + " of " + NumberText(right[0]) + ", give or take " + NumberText(slack));
  }

  void CheckLines(const std::string& place, double error) {
    CheckProbes(place, error);
    CheckProfile(place, error);
  }

  // Samples, places between them, and some outside: x y x y ...
  std::vector<double> SomePlaces() const {
    std::mt19937_64 random(static_cast<uint64_t>(step_.Int("seed", 1)) + 99);
    const Raster& all = terrain_.raster;
    std::vector<double> places;
    for (int i = 0; i < 40; ++i) {
      double u = -1 + (all.columns + 1) * Uniform(random),
             v = -1 + (all.rows + 1) * Uniform(random);
      if (i % 3 == 0) u = std::round(u), v = std::round(v);
      if (i % 7 == 0) v = std::round(v);
      places.insert(places.end(), {all.x0 + u * all.cell, all.y0 - v * all.cell});
    }
    return places;
  }

  void CheckProbes(const std::string& place, double error) {
    const std::vector<double> some = SomePlaces();
    std::string places;
    for (size_t i = 0; i < some.size(); i += 2) {
      places += NumberText(some[i]) + " " + NumberText(some[i + 1]) + "\n";
    }
    WriteText(File("places"), places);
    const auto json =
        Asked("probe", WithError({"probe", place, "--heights", File("places"), "--json"}, error));
    fs::remove(File("places"));
    if (!json) return;
    for (const auto& h : json->at("heights")) {
      const double bound = h.at("error_bound");
      CheckBound("probe", error, bound);
      CheckHeight("probe", h.at("x"), h.at("y"), h.at("height"), error, bound);
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
      CheckHeight("profile", p.at("x"), p.at("y"), p.at("height"), error, bound);
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

  // Pictures of one question are equal, wherever the terrain lies.
  void CheckPictures(const std::vector<std::string>& places, double error) {
    std::mt19937_64 random(static_cast<uint64_t>(step_.Int("seed", 1)) + 5);
    const auto maybe = [&] { return random() % 2 == 0; };
    Arguments how{"--size=60x50", "--error=" + NumberText(error)};
    if (maybe()) how.push_back(maybe() ? "--view=iso" : "--view=front");
    if (maybe()) how.push_back("--exaggerate=" + NumberText(0.5 + Uniform(random)));
    if (maybe()) how.push_back(maybe() ? "--colour=none" : "--colour=height");
    if (maybe()) how.emplace_back("--hillshade");
    if (maybe()) how.emplace_back("--wireframe");
    if (maybe()) {
      const auto image = MakeImage(places.front(), static_cast<uint64_t>(step_.Int("seed", 1)) + 6);
      if (!image) return;
      how.push_back("--drape=" + image->file);
    }
    std::string first;
    for (const std::string& place : places) {
      Arguments arguments{"render", place, File("picture.png")};
      arguments.insert(arguments.end(), how.begin(), how.end());
      ++world_.counts().answers;
      const Ran ran = world_.Mtdb(arguments);
      if (!ran.ok()) return world_.ErrorFault("terrain: picture is refused", ran.err);
      const std::string bytes = ReadText(File("picture.png"));
      if (!bytes.starts_with("\x89PNG") || (!first.empty() && bytes != first)) {
        world_.Fault("terrain: another picture of " + fs::path(place).filename().string(),
                     CommandLine(arguments));
      }
      first = bytes;
    }
  }

  // Makes an image with a place: x = a * column + b * row + c, y = d * column + e * row + f.
  struct PlacedPicture {
    std::string file;
    double a = 0, b = 0, c = 0, d = 0, e = 0, f = 0;
  };
  std::optional<PlacedPicture> MakeImage(const std::string& place, uint64_t seed) {
    std::mt19937_64 random(seed);
    PlacedPicture p;
    p.file = File("image.png");
    const Ran ran = world_.Mtdb({"render", place, p.file, "--size=64x48"});
    if (!ran.ok()) {
      world_.ErrorFault("terrain: picture is refused", ran.err);
      return std::nullopt;
    }
    const Raster& all = terrain_.raster;
    const double wide = all.columns * all.cell * (0.5 + Uniform(random)),
                 high = (all.rows + 1) * all.cell * (0.5 + Uniform(random));
    const double turned = random() % 2 == 0 ? 0 : 0.3 * Uniform(random);
    p.a = wide / 64, p.e = -high / 48, p.b = turned * p.a, p.d = -turned * p.e / 2;
    p.c = all.x0, p.f = all.y0;
    std::string world;
    for (const double n : {p.a, p.d, p.b, p.e, p.c, p.f}) world += NumberText(n) + "\n";
    WriteText(File("image.pgw"), world);
    return p;
  }

  // An image lies where its world file says, at every vertex.
  void CheckDrape(const std::string& place, double error) {
    const auto image = MakeImage(place, static_cast<uint64_t>(step_.Int("seed", 1)) + 11);
    if (!image) return;
    const auto [file, a, b, c, d, e, f] = *image;
    const std::string out = File("draped.glb");
    if (!Asked("extract --drape",
               WithError({"extract", place, out, "--json", "--drape", file}, error))) {
      return;
    }
    const DrapedGlb glb(ReadText(out));
    if (glb.image != ReadText(file)) world_.Fault("terrain: another image is draped", out);
    for (size_t v = 0; v < glb.vertices.size(); ++v) {
      const auto& [p, texture] = glb.vertices[v];
      const double x = p.x - c, y = p.y - f, area = a * e - b * d;
      const double column = (e * x - b * y) / area, row = (a * y - d * x) / area;
      if (std::abs(texture[0] - (column + 0.5) / 64) > 1e-4 ||
          std::abs(texture[1] - (row + 0.5) / 48) > 1e-4) {
        return world_.Fault("terrain: an image lies elsewhere",
                            NumberText(p.x) + " " + NumberText(p.y) + ": " +
                                NumberText(texture[0]) + " " + NumberText(texture[1]));
      }
    }
    if (glb.vertices.empty()) world_.Fault("terrain: nothing is draped", out);
  }

  // A .glb as `extract --drape` writes it.
  struct DrapedGlb {
    std::string image;
    std::vector<std::pair<Vec3d, std::array<double, 2>>> vertices;

    explicit DrapedGlb(const std::string& file) {
      if (file.size() < 20) return;
      uint32_t json_bytes = 0;
      std::memcpy(&json_bytes, &file[12], 4);
      const auto json = nlohmann::json::parse(file.substr(20, json_bytes));
      const std::string binary = file.substr(28 + json_bytes);
      const auto view = [&](size_t i) { return json.at("bufferViews").at(i); };
      const auto bytes = [&](const nlohmann::json& v) {
        return binary.substr(v.value("byteOffset", size_t{0}), v.at("byteLength"));
      };
      image = bytes(view(json.at("images").at(0).at("bufferView")));
      const auto& attributes = json.at("meshes").at(0).at("primitives").at(0).at("attributes");
      const auto at = [&](const char* name, size_t vertex, size_t component) {
        const auto& accessor = json.at("accessors").at(attributes.at(name).get<size_t>());
        const auto of = view(accessor.at("bufferView"));
        const size_t stride = of.at("byteStride");
        float value = 0;
        std::memcpy(&value,
                    &binary.at(of.value("byteOffset", size_t{0}) + vertex * stride +
                               accessor.value("byteOffset", size_t{0}) + component * sizeof(float)),
                    sizeof(value));
        return double{value};
      };
      // In the terrain's own coordinates; its node turns them, and makes metres of them.
      const auto moved =
          json.at("nodes").at(0).at("extras").at("origin").get<std::vector<double>>();
      const size_t count =
          json.at("accessors").at(attributes.at("POSITION").get<size_t>()).at("count");
      for (size_t v = 0; v < count; ++v) {
        vertices.push_back({{moved[0] + at("POSITION", v, 0), moved[1] + at("POSITION", v, 1),
                             moved[2] + at("POSITION", v, 2)},
                            {at("TEXCOORD_0", v, 0), at("TEXCOORD_0", v, 1)}});
      }
    }
  };

  // The C functions, of the store, and of one that they make of the samples.
  void CheckC(double error) {
    const std::string made = File("c.mtdb");
    const std::string fault = IngestByC(made);
    if (!fault.empty()) return world_.ErrorFault("terrain: C: ingest is refused", fault);
    const auto ask = [&](const std::string& store) {
      for (const double e : {-1.0, error}) {
        const std::string refused = AskC(store, e);
        if (!refused.empty()) world_.ErrorFault("terrain: C is refused", refused);
      }
    };
    ask(File("s.mtdb"));
    // To it the rounded samples are what was given, and it knows of no degrees.
    terrain_.given = terrain_.raster;
    metres_ = {1, 1};
    rounding_ = 0;
    ask(made);
  }

  // Of the samples as they are stored.
  std::string IngestByC(const std::string& store) {
    mtdb_error error{};
    mtdb_database* database = nullptr;
    const Raster& all = terrain_.raster;
    mtdb_height_array array{};
    array.struct_bytes = sizeof(array);
    array.columns = all.columns;
    array.rows = all.rows;
    array.heights = all.heights.data();
    const double transform[6] = {all.x0, all.cell, 0, all.y0, 0, -all.cell};
    std::copy_n(transform, 6, array.geotransform);
    mtdb_ingest_options options{};
    options.struct_bytes = sizeof(options);
    options.height_step = step_size_;
    mtdb_code code = mtdb_open_writable(store.c_str(), &database, &error);
    if (code == MTDB_OK) {
      code = mtdb_ingest_heights(database, "t", &array, &options, nullptr, &error);
    }
    mtdb_free_database(database);
    return code == MTDB_OK ? "" : error.message;
  }

  std::string AskC(const std::string& store, double error) {
    mtdb_error why{};
    mtdb_database* database = nullptr;
    mtdb_object* object = nullptr;
    mtdb_code code = mtdb_open(store.c_str(), nullptr, &database, &why);
    if (code == MTDB_OK) code = mtdb_open_object(database, "t", nullptr, &object, &why);
    mtdb_probe_options options{};
    options.struct_bytes = sizeof(options);
    options.error = std::max(error, 0.0);
    mtdb_height_cost cost{};
    cost.struct_bytes = sizeof(cost);
    const auto height = [](double h) {
      return std::isnan(h) ? nlohmann::json() : nlohmann::json(h);
    };
    const std::vector<double> places = SomePlaces();
    std::vector<double> heights(places.size() / 2);
    if (code == MTDB_OK) {
      code = mtdb_find_heights(object, places.data(), heights.size(), &options, heights.data(),
                               &cost, &why);
    }
    for (size_t i = 0; code == MTDB_OK && i < heights.size(); ++i) {
      CheckHeight("C's heights", places[2 * i], places[2 * i + 1], height(heights[i]), error,
                  cost.error_bound);
    }
    world_.counts().answers += 3;
    mtdb_raster raster{};
    raster.struct_bytes = sizeof(raster);
    if (code == MTDB_OK) code = mtdb_get_raster(object, nullptr, nullptr, &raster, &why);
    Raster got = terrain_.raster;
    if (code == MTDB_OK && (raster.columns != got.columns || raster.rows != got.rows)) {
      world_.Fault("terrain: C's raster has another size", "");
    } else if (code == MTDB_OK) {
      code = mtdb_sample_heights(object, &raster, &options, got.heights.data(), got.heights.size(),
                                 &cost, &why);
      if (code == MTDB_OK) CompareSamples("C's raster", got, error, cost.error_bound);
    }
    mtdb_profile* profile = nullptr;
    if (code == MTDB_OK) {
      code = mtdb_find_profile(object, places.data(), 3, &options, &profile, &cost, &why);
    }
    for (size_t i = 0; code == MTDB_OK && i < mtdb_count_profile_points(profile); ++i) {
      const double* const p = mtdb_get_profile_points(profile) + 4 * i;
      if (!std::isnan(p[3])) {
        CheckHeight("C's profile", p[1], p[2], height(p[3]), error, cost.error_bound);
      }
    }
    mtdb_free_profile(profile);
    mtdb_free_object(object);
    mtdb_free_database(database);
    return code == MTDB_OK ? "" : why.message;
  }

  // The same surface as a mesh that is a height field.
  void CheckAsMesh(double error) {
    const std::string ply = File("mesh.ply"), store = File("mesh.mtdb");
    const size_t triangles = WriteMesh(ply);
    const auto json =
        Asked("ingest --terrain", {"ingest", "--json", "--terrain", "--name=m", ply, store});
    if (!json) return;
    if (json->at("triangles") != triangles || json->at("error_measure") != "vertical") {
      world_.Fault("terrain: a mesh becomes another terrain", json->dump());
    }
    step_size_ = json->at("step");
    rounding_ = json->at("rounding_error");
    exact_ = false;
    terrain_.given = terrain_.raster;
    metres_ = {1, 1};
    for (const double e : {-1.0, error}) CheckLines(store, e);
    const Ran verify = world_.Mtdb({"verify", store, "--level", "global"});
    if (!verify.ok()) world_.ErrorFault("terrain: verify", verify.out + verify.err);
    // It may look down as well.
    const auto turned =
        Asked("ingest --terrain of a mesh that looks down",
              {"ingest", "--json", "--terrain", "--name=m", "--replace", Turned(ply), store});
    if (turned && turned->at("triangles") == triangles) {
      CheckLines(store, -1);
    } else if (turned) {
      world_.Fault("terrain: a mesh that looks down becomes another terrain", turned->dump());
    }
  }

  // Returns how many triangles it has.
  size_t WriteMesh(const std::string& path) const {
    const Raster& all = terrain_.raster;
    std::string vertices, faces;
    size_t count = 0, triangles = 0;
    std::vector<size_t> number(all.heights.size());
    for (uint32_t r = 0; r < all.rows; ++r) {
      for (uint32_t c = 0; c < all.columns; ++c) {
        if (!terrain_.Covers(c, r)) continue;
        number[size_t{r} * all.columns + c] = count++;
        vertices += NumberText(terrain_.X({c, r})) + " " + NumberText(terrain_.Y({c, r})) + " " +
                    NumberText(all.At(c, r)) + "\n";
      }
    }
    for (uint32_t r = 0; r + 1 < all.rows; ++r) {
      for (uint32_t c = 0; c + 1 < all.columns; ++c) {
        for (const Terrain::Triangle& t : terrain_.TrianglesOf(c, r)) {
          faces += "3";
          for (const auto& s : t) {
            faces += " " + std::to_string(number[size_t{s[1]} * all.columns + s[0]]);
          }
          faces += "\n";
          ++triangles;
        }
      }
    }
    WriteText(path, "ply\nformat ascii 1.0\nelement vertex " + std::to_string(count) +
                        "\nproperty double x\nproperty double y\nproperty double z\n" +
                        "element face " + std::to_string(triangles) +
                        "\nproperty list uchar int vertex_indices\nend_header\n" + vertices +
                        faces);
    return triangles;
  }

  // With all faces the other way round.
  std::string Turned(const std::string& path) const {
    std::ifstream in(path);
    std::string text, line;
    bool body = false;
    while (std::getline(in, line)) {
      const std::vector<std::string> words = Split(line, ' ');
      if (body && words.size() == 4) {
        line = words[0] + " " + words[2] + " " + words[1] + " " + words[3];
      }
      body = body || line == "end_header";
      text += line + "\n";
    }
    WriteText(File("turned.ply"), text);
    return File("turned.ply");
  }

  World& world_;
  const Step& step_;
  const std::string folder_;
  Terrain terrain_;
  // Of the object that is asked.
  double rounding_ = 0, step_size_ = 0;
  bool exact_ = true;  // its positions are the samples
  std::array<double, 2> metres_{1, 1};
};

}  // namespace

void TerrainAct(World& world, const Step& step) { TerrainWalk(world, step).Run(); }

}  // namespace mtdb::everything
