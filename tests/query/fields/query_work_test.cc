// SPDX-License-Identifier: Apache-2.0
// What questions cost, counted in steps, and how soon a query ends that is cancelled: no times.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "query/fields/work_meter.h"
#include "query/probe.h"
#include "query/query_control.h"
#include "query/query_json.h"
#include "query/session.h"
#include "query/surface.h"
#include "query/verify_object.h"
#include "tests/query/mt_fixture.h"

namespace mtdb::testing {

using namespace internal;

namespace {

using Corner2 = std::array<double, 2>;
using Polygon = std::vector<Corner2>;
constexpr double kPi = std::numbers::pi;

// ---- polygons that are hard on a tree of boxes, about as large as the unit square
// -----------------

Polygon Turned(Polygon polygon, double angle) {
  for (auto& [x, y] : polygon) {
    const double u = x - 0.5;
    const double v = y - 0.5;
    x = 0.5 + u * std::cos(angle) - v * std::sin(angle);
    y = 0.5 + u * std::sin(angle) + v * std::cos(angle);
  }
  return polygon;
}

Polygon Circle(size_t n) {
  Polygon p;
  for (size_t i = 0; i < n; ++i) {
    const double a = 2 * kPi * static_cast<double>(i) / static_cast<double>(n);
    p.push_back({0.5 + 0.4 * std::cos(a), 0.5 + 0.4 * std::sin(a)});
  }
  return p;
}

// Edges from corner to corner across the circle: all of them cross nearly all others.
Polygon Star(size_t n) {
  n |= 1;
  const Polygon circle = Circle(n);
  Polygon p;
  for (size_t i = 0; i < n; ++i) p.push_back(circle[i * (n / 2) % n]);
  return p;
}

// Long teeth, side by side.
Polygon Comb(size_t n) {
  Polygon p;
  for (size_t i = 0; i + 2 < n; ++i) {
    p.push_back({static_cast<double>(i) / static_cast<double>(n), i % 2 == 0 ? 0.1 : 1.0});
  }
  p.push_back({1, 0});
  p.push_back({0, 0});
  return p;
}

// Teeth of all lengths.
Polygon RaggedComb(size_t n) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(0, 1);
  Polygon p = Comb(n);
  for (size_t i = 0; i + 2 < n; ++i)
    p[i][1] = i % 2 == 0 ? 0.5 * unit(random) : 1 - 0.5 * unit(random);
  return p;
}

// A strip that winds to the middle and back.
Polygon Spiral(size_t n) {
  Polygon p;
  for (const bool back : {false, true}) {
    for (size_t i = 0; i < n / 2; ++i) {
      const double s = static_cast<double>(back ? n / 2 - 1 - i : i) / static_cast<double>(n / 2);
      const double turns = 2 * kPi * 50 * s;
      const double r = 0.02 + 0.45 * s + (back ? 0.004 : 0);
      p.push_back({0.5 + r * std::cos(turns), 0.5 + r * std::sin(turns)});
    }
  }
  return p;
}

Polygon Random(size_t n) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> unit(0, 1);
  Polygon p;
  for (size_t i = 0; i < n; ++i) p.push_back({unit(random), unit(random)});
  return p;
}

// Every other corner on one point, the edges between in all directions.
Polygon ThroughOnePlace(size_t n) {
  Polygon p = Circle(n);
  for (size_t i = 0; i < n; i += 2) p[i] = {0.51, 0.52};
  return p;
}

// Long edges through nearly one place, in all directions.
Polygon NearlyThroughOnePlace(size_t n) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> off(-1e-3, 1e-3);
  Polygon p = Circle(n);
  for (size_t i = 1; i < n; i += 2) {
    const double a = std::atan2(p[i - 1][1] - 0.5, p[i - 1][0] - 0.5) + kPi + off(random);
    p[i] = {0.5 + 0.4 * std::cos(a), 0.5 + 0.4 * std::sin(a)};
  }
  return p;
}

Polygon WithDuplicates(size_t n) {
  Polygon p = Circle(n / 4);
  Polygon all;
  for (const Corner2& c : p) all.insert(all.end(), 4, c);  // three edges of length 0 in four
  return all;
}

Polygon OnePoint(size_t n) { return Polygon(n, Corner2{0.4, 0.6}); }

Polygon Flat(size_t n) {
  Polygon p = Random(n);
  for (Corner2& c : p) c[1] = c[0];
  return p;
}

struct Family {
  const char* name;
  std::function<Polygon(size_t)> make;
  bool simple;  // no edge crosses another
};

std::vector<Family> Families() {
  return {{"circle", Circle, true},
          {"comb", Comb, true},
          {"comb aslant", [](size_t n) { return Turned(Comb(n), 0.7); }, true},
          {"comb on its side", [](size_t n) { return Turned(Comb(n), kPi / 2); }, true},
          {"ragged comb aslant", [](size_t n) { return Turned(RaggedComb(n), 0.4); }, true},
          {"spiral", Spiral, true},
          {"duplicates", WithDuplicates, true},
          {"one point", OnePoint, true},
          {"flat", Flat, false},
          {"star", Star, false},
          {"random", Random, false},
          {"through one place", ThroughOnePlace, false},
          {"nearly through one place", NearlyThroughOnePlace, false}};
}

Triangle3d RandomTriangle(std::mt19937& random, double size, const Corner2& origin = {0, 0}) {
  std::uniform_real_distribution<double> unit(0, 1);
  const Vec3d at{origin[0] + unit(random), origin[1] + unit(random), unit(random)};
  Triangle3d t;
  for (Vec3d& p : t) {
    p = at + Vec3d{unit(random) - 0.5, unit(random) - 0.5, unit(random) - 0.5} * size;
  }
  return t;
}

// ---- the definitions, edge by edge
// -----------------------------------------------------------------

bool OverPolygon(const Polygon& polygon, Vec3d p) {
  bool inside = false;
  for (size_t i = 0; i < polygon.size(); ++i) {
    const auto& [ax, ay] = polygon[i];
    const auto& [bx, by] = polygon[(i + 1) % polygon.size()];
    if ((ay > p.y) != (by > p.y) && p.x - ax < (p.y - ay) * ((bx - ax) / (by - ay))) {
      inside = !inside;
    }
  }
  return inside;
}

double DistanceFromEdges(const Polygon& polygon, const Triangle3d& t) {
  Triangle3d flat = t;
  for (Vec3d& p : flat) p.z = 0;
  double least = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < polygon.size(); ++i) {
    const auto& [ax, ay] = polygon[i];
    const auto& [bx, by] = polygon[(i + 1) % polygon.size()];
    least = std::min(least, SquaredDistanceSegmentTriangle({ax, ay, 0}, {bx, by, 0}, flat));
  }
  return std::sqrt(least);
}

}  // namespace

TEST_CASE("Regions of hostile polygons answer as edge by edge", "[hostile]") {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  for (const Corner2 origin : {Corner2{0, 0}, Corner2{-50, 7e5}}) {
    const double rounding = origin[1] > 0 ? 1e-6 : 1e-10;
    for (const Family& family : Families()) {
      INFO(family.name << " at " << origin[1]);
      Polygon polygon = family.make(600);
      for (Corner2& c : polygon) c = {c[0] + origin[0], c[1] + origin[1]};
      const RegionPtr prism = PrismRegion(polygon);
      std::vector<Vec3d> line;
      for (const auto& [x, y] : polygon) line.push_back({x, y, 0});
      line.push_back(line.front());
      const RegionPtr tube = TubeRegion(line, 0.01);
      size_t in = 0;
      for (int i = 0; i < 2000; ++i) {
        const Triangle3d t = RandomTriangle(random, std::pow(10, -4 * unit(random)), origin);
        const double distance = 0.05 * std::max(0.0, unit(random) - 0.5);
        const double from_edges = DistanceFromEdges(polygon, t);
        const bool over = OverPolygon(polygon, t[0]);
        in += over ? 1 : 0;
        if (std::abs(from_edges - distance) > rounding) {
          const bool near = from_edges <= distance;
          REQUIRE(prism->Within(t, distance) == (near || over));
          REQUIRE(prism->Covers(t, distance) == (over && !near));
          Box3d box;
          for (const Vec3d& p : t) box.Add(p);
          if (prism->Within(t, distance)) REQUIRE(prism->BoxWithin(box, distance));
          if (!prism->Covers(t, distance)) REQUIRE(!prism->BoxCovers(box, distance));
        }
        Triangle3d flat = t;
        for (Vec3d& p : flat) p.z = 0;
        if (std::abs(from_edges - distance - 0.01) > rounding) {
          REQUIRE(tube->Within(flat, distance) == (from_edges <= distance + 0.01));
        }
      }
      const std::string name = family.name;
      if (name != "one point" && name != "flat" && name != "through one place") CHECK(in > 0);
    }
  }
}

TEST_CASE("A question to a region of 100,000 corners takes few steps", "[hostile]") {
  // Where edges do not cross, where as many as can be end at each height, and where all of them
  // cross nearly all others. Asking each edge takes more than 100,000, and some questions ask
  // thrice.
  constexpr uint64_t kMostOfSimple = 2'500;
  constexpr uint64_t kMostOfRagged = 15'000;
  constexpr uint64_t kMost = 35'000;
  for (const Family& family : Families()) {
    const Polygon polygon = family.make(100'000);
    const RegionPtr prism = PrismRegion(polygon, 0.2, 0.8);
    std::vector<Vec3d> line;
    for (const auto& [x, y] : polygon) line.push_back({x, y, 0.5});
    const RegionPtr tube = TubeRegion(line, 1e-4);
    WorkMeter meter([] { return Status::Ok(); });
    std::mt19937 random(2);
    uint64_t most = 0;
    uint64_t sum = 0;
    const auto ask = [&](const auto& question) {
      const uint64_t before = meter.steps();
      question();
      most = std::max(most, meter.steps() - before);
      sum += meter.steps() - before;
    };
    for (int i = 0; i < 3000; ++i) {
      const double size = i % 2 == 0 ? 1e-3 : 1e-2;
      const Triangle3d t = RandomTriangle(random, size);
      Box3d box;
      for (const Vec3d& p : t) box.Add(p);
      for (const RegionPtr& region : {prism, tube}) {
        ask([&] { return region->Within(t, 1e-4); });
        if (region == prism) ask([&] { return region->Covers(t, 1e-4); });
        ask([&] { return region->BoxWithin(box, 1e-4); });
        ask([&] { return region->BoxCovers(box, 1e-4); });
      }
    }
    INFO(family.name << ": " << most << " steps at most, " << sum / 21'000 << " on average");
    const bool ragged = std::string(family.name).starts_with("ragged");
    CHECK(most <= (!family.simple ? kMost : ragged ? kMostOfRagged : kMostOfSimple));
  }
}

TEST_CASE("A query has a bounded number of regions and thresholds") {
  const auto list = [](const char* part, int count) {
    std::string text;
    for (int i = 0; i < count; ++i) text += (i > 0 ? ", " : "") + std::string(part);
    return text;
  };
  const auto regions = [&](int count) {
    return R"({"region": {"union": [)" + list(R"({"point": [0, 0, 0]})", count) + "]}}";
  };
  const auto thresholds = [&](int count) {
    return R"({"threshold": {"smallest": [)" + list("0.1", count) + "]}}";
  };
  CHECK(ParseQuery(regions(4095), 1).ok());
  CHECK(ParseQuery(thresholds(4095), 1).ok());
  for (const std::string& text : {regions(4096), thresholds(4096)}) {
    const Status status = ParseQuery(text, 1).status();
    CHECK(status.code() == StatusCode::kInvalidArgument);
    CHECK(status.message().find("at most 4096 regions and thresholds") != std::string::npos);
  }
}

// ---- cancellation
// ----------------------------------------------------------------------------------

namespace {

// Every question is answered as by `inner`; the n-th cancels. What is asked later is counted.
class Cancelling final : public Region {
 public:
  Cancelling(RegionPtr inner, QueryControl* control, uint64_t nth)
      : inner_(std::move(inner)), control_(control), nth_(nth) {}
  bool Within(const Triangle3d& t, double d) const override {
    Count();
    return inner_->Within(t, d);
  }
  bool Covers(const Triangle3d& t, double d) const override {
    Count();
    return inner_->Covers(t, d);
  }
  bool BoxWithin(const Box3d& b, double d) const override {
    Count();
    return inner_->BoxWithin(b, d);
  }
  bool BoxCovers(const Box3d& b, double d) const override {
    Count();
    return inner_->BoxCovers(b, d);
  }
  uint64_t questions() const { return questions_; }

 private:
  void Count() const {
    if (++questions_ == nth_) control_->Cancel();
  }
  RegionPtr inner_;
  QueryControl* control_;
  uint64_t nth_;
  mutable uint64_t questions_ = 0;
};

MtFixture Large() { return MakeTorus(48, 8); }

std::shared_ptr<Surface> Open(const MtFixture& f, size_t cache_bytes = size_t{64} << 20) {
  SurfaceOptions options;
  options.threads = 1;
  options.cache_bytes = cache_bytes;
  return Surface::Open(f.source, options).value();
}

RegionPtr Half(const MtFixture& f) {
  const Box3d& box = f.source->record_.bounds;
  return SphereRegion(box.max, Diagonal(box) * 0.6);
}

class NoSink final : public MeshSink {
 public:
  Status Begin(const MeshHeader&) override { return Status::Ok(); }
  Status AddVertices(std::span<const Vec3d>, ByteSpan) override { return Status::Ok(); }
  Status AddTriangles(std::span<const TriangleVertices>) override { return Status::Ok(); }
  Status End() override { return Status::Ok(); }
};

// Ways to ask; each returns a Status.
using Ask = std::function<Status(const std::shared_ptr<Surface>&, const Query&)>;

Status Extracted(const std::shared_ptr<Surface>& surface, const Query& query) {
  NoSink sink;
  return surface->Extract(query, sink).status();
}
struct Way {
  const char* name;
  Ask ask;
};

std::vector<Way> WaysToAsk() {
  return {
      {"from nothing", Extracted},
      {"clipped",
       [](const auto& surface, Query query) {
         query.clip = true;
         return Extracted(surface, query);
       }},
      {"with normals",
       [](const auto& surface, Query query) {
         query.clip = query.normals = true;
         return Extracted(surface, query);
       }},
      {"few triangles",
       [](const auto& surface, Query query) {
         query.max_triangles = 4000;
         return Extracted(surface, query);
       }},
      {"session",
       [](const auto& surface, const Query& query) -> Status {
         const auto session = Session::Open(surface).value();
         std::vector<UpdateBatch> batches;
         return session->Update(query, &batches).status();
       }},
      {"session that moves",
       [](const auto& surface, const Query& query) -> Status {
         const auto session = Session::Open(surface).value();
         std::vector<UpdateBatch> batches;
         Query all;
         all.threshold = ConstantThreshold(0.01);
         REQUIRE(session->Update(all, &batches).ok());
         const uint64_t before = session->applied_count();
         const Status status = session->Update(query, &batches).status();
         if (!status.ok()) REQUIRE(session->applied_count() == before);
         return status;
       }},
      {"session with a budget",
       [](const auto& surface, Query query) -> Status {
         query.max_triangles = 4000;
         const auto session = Session::Open(surface).value();
         std::vector<UpdateBatch> batches;
         return session->Update(query, &batches).status();
       }},
  };
}

}  // namespace

TEST_CASE("After a cancellation at any question few more are asked", "[hostile]") {
  const MtFixture f = Large();
  const auto surface = Open(f);
  constexpr uint64_t kMostMore = 2 * WorkMeter::kStepsPerLook;
  for (const Way& way : WaysToAsk()) {
    const char* const name = way.name;
    const Ask& ask = way.ask;
    Query query;
    query.threshold = LinearThreshold(f.source->record_.bounds.min, 0, 0.001);
    const auto count = [&](uint64_t nth, Status* status) {
      QueryControl control;
      const auto region = std::make_shared<Cancelling>(Half(f), &control, nth);
      query.region = region;
      query.control = &control;
      *status = ask(surface, query);
      return region->questions();
    };
    Status status;
    const uint64_t all = count(0, &status);
    INFO(name << ": " << all << " questions");
    REQUIRE(status.ok());
    CHECK(all > 4 * kMostMore);
    for (uint64_t nth = 1; nth + kMostMore < all; nth += 1 + nth / 5) {
      INFO("the " << nth << "-th cancels");
      const uint64_t asked = count(nth, &status);
      REQUIRE(status.code() == StatusCode::kCancelled);
      REQUIRE(asked <= nth + kMostMore);
    }
  }
}

TEST_CASE("A question that lasts is ended by a cancellation", "[hostile]") {
  // Asks for steps until it is told to end.
  class Endless final : public Region {
   public:
    explicit Endless(QueryControl* control) : control_(control) {}
    bool Within(const Triangle3d&, double) const override { return Last(); }
    bool Covers(const Triangle3d&, double) const override { return Last(); }
    bool BoxWithin(const Box3d&, double) const override { return Last(); }
    bool BoxCovers(const Box3d&, double) const override { return false; }
    mutable uint64_t steps = 0;

   private:
    bool Last() const {
      for (int i = 0; i < 10'000; ++i) {
        if (!SpendSteps(1)) return true;
      }
      control_->Cancel();
      while (SpendSteps(1)) ++steps;
      return true;
    }
    QueryControl* control_;
  };
  const MtFixture f = Large();
  const auto surface = Open(f);
  for (const Way& way : WaysToAsk()) {
    const char* const name = way.name;
    const Ask& ask = way.ask;
    INFO(name);
    QueryControl control;
    const auto region = std::make_shared<Endless>(&control);
    Query query;
    query.region = region;
    query.control = &control;
    CHECK(ask(surface, query).code() == StatusCode::kCancelled);
    CHECK(region->steps <= WorkMeter::kStepsPerLook);
  }
}

TEST_CASE("After a cancellation at any read no more than one is done", "[hostile]") {
  const MtFixture f = MakeMt({.shape = Shape::kTorus, .resolution = 24, .rounds = 4, .tiles = 8});
  std::vector<Way> ways = WaysToAsk();
  const Vec3d centre = (f.source->record_.bounds.min + f.source->record_.bounds.max) * 0.5;
  ways.push_back({"probe", [&](const auto& surface, const Query& query) {
                    ProbeOptions options;
                    options.control = query.control;
                    return FindClosestPoint(*surface, centre, options).status();
                  }});
  ways.push_back({"ray", [&](const auto& surface, const Query& query) {
                    ProbeOptions options;
                    options.control = query.control;
                    return CastRay(*surface, centre, {1, 0.1, 0.3}, options).status();
                  }});
  for (const VerifyLevel level : {VerifyLevel::kFull, VerifyLevel::kGlobal}) {
    ways.push_back({"verify", [level](const auto& surface, const Query& query) {
                      CheckReport report;
                      const Status status = VerifyObject(*surface, level, &report, query.control);
                      if (status.ok()) REQUIRE(report.ok());
                      return status;
                    }});
  }
  ways.push_back({"everything", [](const auto& surface, Query query) {
                    query.region = nullptr;
                    query.threshold = nullptr;
                    return Extracted(surface, query);
                  }});
  Query half;
  half.region = Half(f);
  half.threshold = ConstantThreshold(0.01);
  // So small a cache that each pass over the clusters reads them again.
  size_t cache = 1 << 14;
  const auto suffices = [&](const Way& way) {
    QueryControl control;
    Query query = half;
    query.control = &control;
    return way.ask(Open(f, cache), query).ok();
  };
  while (!std::ranges::all_of(ways, suffices)) cache += cache / 8;
  for (const Way& way : ways) {
    const char* const name = way.name;
    const Ask& ask = way.ask;
    const auto count = [&](uint64_t nth, Status* status) {
      QueryControl control;
      uint64_t reads = 0;
      f.source->on_read_ = [&](uint32_t) {
        if (++reads == nth) control.Cancel();
        return Status::Ok();
      };
      Query query = half;
      query.control = &control;
      *status = ask(Open(f, cache), query);
      f.source->on_read_ = nullptr;
      return reads;
    };
    Status status;
    const uint64_t all = count(0, &status);
    INFO(name << ": " << all << " reads");
    INFO(status.message());
    REQUIRE(status.ok());
    for (uint64_t nth = 1; nth < all; ++nth) {
      INFO("the " << nth << "-th cancels");
      const uint64_t reads = count(nth, &status);
      // A session closes what it does not need when its new cut has been handed over; one that
      // moves reads for its first cut, which the control does not know.
      // A check reads a cluster with those that it comes from.
      const uint64_t more = std::string(name) == "verify" ? 8 : 0;
      if (status.ok()) {
        REQUIRE((std::string(name).starts_with("session") || nth + more >= all));
        continue;
      }
      REQUIRE(status.code() == StatusCode::kCancelled);
      REQUIRE((reads <= nth + more || std::string(name) == "session that moves"));
    }
  }
}

}  // namespace mtdb::testing
