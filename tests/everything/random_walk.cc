// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/random_walk.h"

#include <cmath>
#include <initializer_list>
#include <random>

#include "tests/everything/input.h"
#include "tests/everything/input_files.h"
#include "tests/everything/output_files.h"
#include "tests/everything/question.h"

namespace mtdb::everything {

namespace {

constexpr const char* kNames[] = {"a", "b", "left/c", "d e", "ü"};
constexpr const char* kAliases[] = {"plain", "relative", "symlink", "hardlink", "folder"};

class Maker {
 public:
  explicit Maker(uint64_t seed) : random_(seed) { walk_.seed = seed; }

  Walk Make() {
    Ingest(false);
    const int64_t rounds = Between(1, 4);
    for (int64_t i = 0; i < rounds; ++i) {
      for (int64_t k = Between(0, 2); k > 0; --k) Ask();
      if (Chance(0.4)) Probe();
      Act();
    }
    Ask();
    if (Chance(0.3)) Add("verify");
    if (Chance(0.15)) Add("verify").Set("packed", static_cast<int64_t>(Scaled(1, 300)) - 1);
    return walk_;
  }

 private:
  double Uniform(double low, double high) {
    // Not std::uniform_real_distribution, which libraries implement as they like.
    return low + (high - low) * (static_cast<double>(random_() >> 11) * 0x1p-53);
  }
  bool Chance(double p) { return Uniform(0, 1) < p; }
  int64_t Between(int64_t low, int64_t high) {
    return low + static_cast<int64_t>(random_() % static_cast<uint64_t>(high - low + 1));
  }
  template <typename List>
  auto OneOf(const List& list) {
    return std::data(list)[random_() % std::size(list)];
  }
  // From low to high, as often below their geometric mean as above.
  double Scaled(double low, double high) { return low * std::pow(high / low, Uniform(0, 1)); }
  std::string Short(double value) {
    return NumberText(std::stod(std::to_string(value)) == 0 ? value
                                                            : std::round(value * 1e6) / 1e6);
  }

  Step& Add(const std::string& act) {
    walk_.steps.push_back({act, {}});
    if (Chance(0.2)) walk_.steps.back().Set("store", 1);
    return walk_.steps.back();
  }

  void Act() {
    switch (Between(0, 27)) {
      case 27: return Tile();
      case 26: return Aim();
      case 25: return Pour();
      case 24: {
        Step& step = Add("page");
        step.Set("seed", Between(0, 2));
        if (Chance(0.5)) step.Set("source", 1);
        return;
      }
      case 23:
      case 22: return Beside();
      case 21: return Picture();
      case 20: {
        Step& step = Add("pack-onto");
        if (Chance(0.5)) step.Set("itself", 1);
        if (Chance(0.3)) step.Set("by", OneOf(kAliases));
        return;
      }
      case 19:
      case 18: return Terrain();
      case 17:
      case 16: return Rename();
      case 15: return CopyInto();
      case 14: return Compact();
      case 13: return Killed();
      case 0:
      case 1: return Interrupted();
      case 2:
      case 3: return Pair();
      case 4:
      case 5: {
        Step& step = Add("remove");
        step.Set("name", Name());
        if (Chance(0.3)) step.Set("by", OneOf(kAliases));
        return;
      }
      case 6: Add("copy"); return;
      case 7: Add("restart"); return;
      default: return Ingest(Chance(0.4));
    }
  }

  void Tile() {
    Step& step = Add("tile");
    step.Set("triangles", static_cast<int64_t>(Scaled(100, 20000)));
    step.Set("harm", Between(0, 1000));
    if (Chance(0.3)) step.Set("at", 1);
    if (Chance(0.5)) step.Set("operation", static_cast<int64_t>(Scaled(1, 300)));
    if (!Chance(0.5)) return;
    step.Set("segments", 1);
    if (Chance(0.5)) step.Set("bits", 10);
    if (Chance(0.5)) step.Set("sharded", 1);
  }

  void Picture() {
    Step& step = Add("picture");
    step.Set("view", OneOf(std::initializer_list<const char*>{"auto", "front", "top", "iso"}));
    step.Set("error", Short(Scaled(1e-4, 0.3)));
    for (const char* key : {"draft", "smooth", "wireframe", "scale-bar"}) {
      if (Chance(0.4)) step.Set(key, 1);
    }
  }

  void Terrain() {
    Step& step = Add("terrain");
    step.Set("seed", Between(1, 100000));
    step.Set("columns", static_cast<int64_t>(Scaled(2, 70)));
    step.Set("rows", static_cast<int64_t>(Scaled(1, 70)));
    if (Chance(0.5)) {
      step.Set("format", OneOf(std::initializer_list<const char*>{"hgt", "tif", "vrt"}));
    }
    if (Chance(0.3)) step.Set("tiles", Between(2, 3));
    if (Chance(0.3)) {
      step.Set("fill", Between(1, 12));
      step.Set("holes", Short(Scaled(0.05, 1.5)));  // of which some touch
    }
    for (const char* key : {"mesh", "c", "drape", "picture"}) {
      if (Chance(0.4)) step.Set(key, 1);
    }
    for (const char* key : {"overlap", "order", "centre", "tmp"}) {
      if (Chance(0.3)) step.Set(key, 1);
    }
    if (!step.has("fill") && Chance(0.5)) step.Set("holes", Short(Scaled(0.001, 0.9)));
    if (Chance(0.6)) step.Set("decimals", Between(0, 4));
    if (Chance(0.6)) step.Set("cell", Short(Scaled(0.0002, 100)));
    if (Chance(0.5)) {
      step.Set("x", Between(-600000, 600000));
      step.Set("y", Between(-5000000, 5000000));
    }
    if (Chance(0.3)) step.Set("step-z", Short(Scaled(0.001, 50)));
    step.Set("error", Short(Scaled(1e-4, 0.5)));
    if (Chance(0.3)) step.Set("operation", Between(1, 110));
    if (Chance(0.2)) step.Set("threads", Between(1, 4));
  }

  std::string Name() { return Chance(0.5) ? "a" : OneOf(kNames); }

  void Rename() {
    Step& step = Add("rename");
    step.Set("name", Name());
    step.Set("to", Name());
    if (Chance(0.2)) step.Set("by", OneOf(kAliases));
  }

  // What changes an object while somebody reads it.
  void Beside() {
    const int64_t change = Between(0, 3);
    if (change == 0) Ingest(true);
    if (change == 1) Rename();
    if (change == 2) Add("remove").Set("name", Name());
    if (change == 3) Compact();
    Step& step = walk_.steps.back();
    step.Set("change", std::string(step.act));
    step.act = "beside";
    step.Set("from", OneOf(std::initializer_list<const char*>{"packed", "mesh", "store"}));
    if (change == 3) step.Set("from", std::string("packed"));
    for (const char* key : {"wide", "memory", "operation"}) step.with.erase(key);
    if (Chance(0.5)) step.Set("error", Short(Scaled(1e-4, 0.1)));
    step.Set("of", Between(0, 3));
  }

  void CopyInto() {
    Step& step = Add("copy-into");
    if (Chance(0.5)) step.Set("name", Name());
    if (Chance(0.3)) step.Set("force", 1);
    if (Chance(0.2)) step.Set("by", OneOf(kAliases));
    if (Chance(0.2)) step.Set("by2", OneOf(kAliases));
    if (Chance(0.25)) step.Set("operation", Between(1, 60));
  }

  void Compact() {
    Step& step = Add("compact");
    if (Chance(0.2)) step.Set("by", OneOf(kAliases));
    if (Chance(0.8)) step.Set("alone", 1);
    if (Chance(0.3)) step.Set("operation", Between(1, 60));
  }

  void Ingest(bool replace) {
    Step& step = Add("ingest");
    step.Set("name", Name());
    if (replace) step.Set("force", 1);
    if (Chance(0.3)) step.Set("by", OneOf(kAliases));
    Input(&step);
    Options(&step);
    if (Chance(0.2)) step.Set("via", std::string("library"));
    if (step.Text("via") == "library") step.Set("tile", Between(64, 2000));
  }

  void Input(Step* step) {
    step->Set("shape", OneOf(ShapeNames()));
    step->Set("shapeseed", Between(1, 1000));
    step->Set("size", static_cast<int64_t>(Scaled(4, 2500)));
    if (Chance(0.04)) step->Set("size", Between(9000, 20000));
    // What a small cache cannot hold.
    large_ = Chance(0.04);
    if (large_) step->Set("size", Between(60000, 120000));
    if (Chance(0.6)) {
      step->Set("place", OneOf(std::initializer_list<const char*>{"tiny", "huge", "utm", "side"}));
    }
    if (Chance(0.4)) step->Set("double", 1);
    if (Chance(0.3)) step->Set("snap", Between(4, 12));
    for (const char* key : {"stray", "twins", "spoilt"}) {
      if (Chance(0.12)) step->Set(key, 1);
    }
    Attributes(step);
    if (Chance(0.25)) step->Set("files", Between(2, 5));
    std::string formats;
    for (int64_t i = step->Int("files", 1); i > 0; --i) {
      formats += (formats.empty() ? "" : ",") + std::string(OneOf(FileFormats()).name);
      if (Chance(0.6)) break;
    }
    if (Chance(0.7)) step->Set("format", formats);
    if (step->has("files") && Chance(0.3)) step->Set("order", 1);
    if (Chance(0.12)) step->Set("gzip", 1);
    if (Chance(0.3)) step->Set("polygons", 1);
    if (Chance(0.15)) step->Set("bom", 1);
    if (Chance(0.3)) step->Set("lineend", std::string(Chance(0.5) ? "cr" : "crlf"));
    if (Chance(0.12)) step->Set("stdin", 1);
    if (Chance(0.2)) step->Set("weld", Chance(0.4) ? "0" : Short(Scaled(1e-6, 0.03)));
    if (Chance(0.2)) step->Set("cut", Chance(0.5) ? "1" : Short(Scaled(0.01, 0.5)));
    if (Chance(0.08)) step->Set("apart", 1);
    if (Chance(0.12)) step->Set("flipped", Short(Scaled(0.001, 0.9)));
    if (Chance(0.15)) step->Set("orient", 1);
    if (Chance(0.06)) step->Set("far", Short(Scaled(1e2, 1e9)));
  }

  void Attributes(Step* step) {
    if (Chance(0.35)) return;
    std::string kinds;
    for (const std::string& kind : AttributeKinds()) {
      if (Chance(0.35)) kinds += (kinds.empty() ? "" : ",") + kind;
    }
    if (!kinds.empty()) step->Set("attr", kinds);
    if (!Chance(0.12)) return;
    // Rows of up to 20 KB, of few vertices or of many.
    step->Set("wide", static_cast<int64_t>(Scaled(8, 2500)));
    if (Chance(0.5)) {
      const double most = 1e8 / (8.0 * static_cast<double>(step->Int("wide", 1)));
      step->Set("size", static_cast<int64_t>(std::min(130000.0, Scaled(3000, most + 5000))));
      step->Set("memory", 256);
      step->Set("format", std::string("ply"));
    }
  }

  void Options(Step* step) {
    switch (Between(0, 5)) {
      case 0: step->Set("lossless", 1); break;
      case 1: step->Set("step", Short(Scaled(1e-5, 0.05))); break;
      case 2:
      case 3: step->Set("bits", Chance(0.3) ? 0 : Between(3, 24)); break;
      default: break;
    }
    if (Chance(0.02)) step->Set("step", std::string("1e-9"));
    if (Chance(0.5)) step->Set("normals", Between(4, 16));
    if (Chance(0.5)) step->Set("round", Short(Scaled(0.001, 1)));
    if (Chance(0.3)) step->Set("threads", Between(1, 8));
    if (Chance(0.2)) step->Set("memory", Between(256, 400));
    if (Chance(0.2)) step->Set("tmp", 1);
  }

  // An ingest that is killed at some operation on a file, and what may come then.
  void Killed() {
    Ingest(Chance(0.5));
    Step& killed = walk_.steps.back();
    for (const char* key : {"via", "tile", "wide", "memory", "spoilt", "stdin"})
      killed.with.erase(key);
    killed.Set("size", Between(50, 2500));
    killed.Set("operation", Between(1, 110));
    if (Chance(0.3)) killed.Set("list", 1);
    Step next = killed;
    next.with.erase("operation");
    if (Chance(0.6)) next.Set("resume", 1);
    if (Chance(0.3)) next.Set("force", next.Flag("force") ? 0 : 1);
    if (Chance(0.2)) Ask();
    if (Chance(0.2)) Rename();
    walk_.steps.push_back(next);
  }

  // An ingest that is killed, and one that goes on, of the same or of something else.
  void Interrupted() {
    Step killed = Add("ingest");
    walk_.steps.pop_back();
    killed.Set("name", Name());
    Input(&killed);
    Options(&killed);
    if (Chance(0.8)) {
      killed.Set("size", Between(1500, 6000));
      killed.Set("via", std::string("library"));
      killed.Set("tile", Between(100, 600));
      killed.Set("kill", Between(3, 14));
    } else {
      killed.with.erase("stdin");  // which cannot be read again
      killed.Set("size", Between(18000, 30000));
      killed.Set("kill", Between(1, 25));
    }
    for (const char* key : {"wide", "memory"}) killed.with.erase(key);
    killed.Set("force", 1);
    if (killed.Text("shape") == "tangle" || killed.Text("shape") == "nasty") {
      killed.Set("shape", std::string("sculpture"));
    }
    Step next = killed;
    next.with.erase("kill");
    next.Set("resume", 1);
    switch (Between(0, 7)) {
      case 0: break;
      case 7: next.Set("weld", Chance(0.4) ? "0" : Short(Scaled(1e-6, 0.03))); break;
      case 1:
      case 2: next.Set("attrseed", 2); break;
      case 3: next.Set("order", next.Flag("order") ? 0 : 1); break;
      case 4: next.Set("shapeseed", killed.Int("shapeseed", 1) + 1); break;
      case 5: Options(&next); break;
      default: Attributes(&next); break;
    }
    for (const char* key : {"wide", "memory"}) next.with.erase(key);
    if (Chance(0.3)) next.Set("threads", Between(1, 8));
    if (Chance(0.3)) next.Set("memory", Between(256, 600));
    walk_.steps.push_back(killed);
    if (Chance(0.2)) Ask();
    walk_.steps.push_back(next);
  }

  void Pair() {
    Step& step = Add("pair");
    step.Set("name", OneOf(kNames));
    step.Set("name2", std::string("second"));
    step.Set("force", 1);
    step.Set("by", OneOf(kAliases));
    step.Set("by2", OneOf(kAliases));
    Input(&step);
    Options(&step);
    step.with.erase("memory");
    step.with.erase("wide");
    step.Set("size", Between(50, 3000));
  }

  std::string PlaceInBox() {
    std::string text;
    for (int i = 0; i < 3; ++i) text += (i == 0 ? "" : ",") + Short(Uniform(-0.1, 1.1));
    return text;
  }

  void Ask() {
    Step& step = Add("ask");
    step.Set("of", Between(0, 3));
    if (Chance(0.6)) {
      step.Set("region", OneOf(RegionNames()));
      step.Set("at", PlaceInBox());
      step.Set("r", Short(Scaled(0.02, 0.8)));
      if (Chance(0.25)) {
        step.Set("region2", OneOf(RegionNames()));
        step.Set("at2", PlaceInBox());
        step.Set("r2", Short(Scaled(0.02, 0.8)));
        if (Chance(0.5)) step.Set("combine", std::string("intersection"));
      }
      if (Chance(0.2)) step.Set("outside", 1);
      if (Chance(0.35)) step.Set("clip", 1);
    }
    step.Set("threshold", OneOf(ThresholdNames()));
    if (Chance(0.4)) step.Set("threshold", std::string("constant"));
    step.Set("error", Short(Scaled(1e-5, 0.3)));
    if (Chance(0.3)) step.Set("error2", Short(Scaled(1e-4, 0.3)));
    if (Chance(0.3)) step.Set("slope", Short(Uniform(-0.1, 0.3)));
    if (Chance(0.2)) step.Set("triangles", Short(Uniform(0, 1)));
    if (Chance(0.05)) step.Set("ms", OneOf(std::initializer_list<const char*>{"0", "0.05", "1e5"}));
    if (Chance(0.3)) step.Set("remember", Between(0, 40));
    if (Chance(0.3)) step.Set("detour", 1);
    if (Chance(0.35)) {
      step.Set("moves", Between(1, 6));
      step.Set("moves-by", Short(Scaled(0.001, 0.1)));
      if (Chance(0.3)) step.Set("grows", 1);
      if (Chance(0.5)) step.Set("focus", PlaceInBox());
    }
    if (Chance(0.07)) step.Set("bytes", static_cast<int64_t>(Scaled(100, 100000)));
    if (Chance(0.2)) step.Set("normals", 1);
    if (Chance(0.2)) step.Set("implicit", 1);
    if (Chance(0.05)) step.Set("python", 1);
    if (Chance(0.6)) step.Set("output", OneOf(kOutputFormats).extension);
    if (Chance(0.1)) step.Set("by", OneOf(kAliases));
    if (Chance(0.25)) {
      step.Set("unsteady", OneOf(std::initializer_list<const char*>{"replaced", "silent", "gone",
                                                                    "missing", "swapped"}));
      step.Set("requests", Between(1, 6));
    }
    if (Chance(0.25)) {
      step.Set("kept",
               OneOf(std::initializer_list<const char*>{"whole", "lies", "flip", "cut", "zero",
                                                        "gone", "fifo", "folder", "link"}));
      step.Set("kept-at", Short(Uniform(0, 1)));
      if (Chance(0.4)) step.Set("kept-twice", 1);
      if (Chance(0.3))
        step.Set("kept-size", OneOf(std::initializer_list<const char*>{"1", "100K"}));
    }
    if (Chance(large_ ? 1 : 0.3)) {
      step.Set("cache", std::to_string(static_cast<int64_t>(Scaled(10, 3000))) + "K");
      step.Set("spill", OneOf(std::initializer_list<const char*>{"kept", "missing", "enospc", "eio",
                                                                 "short"}));
      step.Set("spill-at", static_cast<int64_t>(Scaled(1, 40)));
    }
  }

  void Aim() {
    Step& step = Add("aim");
    if (Chance(0.5)) step.Set("packed", 1);
    if (Chance(0.5)) step.Set("by", "hardlink");
    if (Chance(0.3)) step.Set("picture", 1);
    step.Set("output", OneOf(kOutputFormats).extension);
    if (!step.has("picture") && Chance(0.2)) {
      step.Set("generate", 1);
      step.Set("output", "ply");
    }
  }

  void Pour() {
    using Words = std::initializer_list<const char*>;
    Step& step = Add("pour");
    step.Set("stream", OneOf(Words{"zeros", "words", "mesh", "late", "silence"}));
    step.Set("format", OneOf(Words{"stl", "ply", "obj", "off", "glb", "gltf", "drc"}));
    step.Set("signal", OneOf(Words{"TERM", "INT"}));
  }

  void Probe() {
    Step& step = Add("probe");
    step.Set("of", Between(0, 3));
    const auto place = [&] {
      std::string text;
      for (int i = 0; i < 3; ++i) text += (i == 0 ? "" : ",") + Short(Uniform(-1, 2));
      return text;
    };
    step.Set("at", Chance(0.5) ? place() : PlaceInBox());
    if (Chance(0.5)) {
      step.Set("ray", 1);
      step.Set("to", PlaceInBox());
    }
    if (Chance(0.5)) step.Set("error", Short(Scaled(1e-5, 0.3)));
    if (Chance(0.3)) step.Set("limit", Short(Scaled(0.01, 3)));
  }

  std::mt19937_64 random_;
  bool large_ = false;  // the last input
  Walk walk_;
};

}  // namespace

Walk RandomWalk(uint64_t seed) { return Maker(seed).Make(); }

}  // namespace mtdb::everything
