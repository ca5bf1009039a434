// SPDX-License-Identifier: Apache-2.0
#include "builder/surface/height_field.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

#include "builder/intake/corner_gather.h"
#include "builder/intake/grid_choice.h"

namespace mtdb::internal {

namespace {

constexpr int kFinestBits = 24;

std::string Text(double v) {
  char text[40];
  std::snprintf(text, sizeof(text), "%.9g", v);
  return text;
}
std::string PlaceText(Vec3d p) { return Text(p.x) + ", " + Text(p.y) + ", " + Text(p.z); }

Status NoHeightField(const std::string& what) {
  return BadInput("is no height field, so no terrain: " + what);
}

// Twice the area seen from above.
template <typename T>
T AreaAbove(const Vec3<T>& a, const Vec3<T>& b, const Vec3<T>& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

Vec3<int64_t> Wide(Vec3i p) { return {p.x, p.y, p.z}; }

int Sign(int64_t v) { return (v > 0) - (v < 0); }

Status FoldedByGrid(const Grid& grid) {
  return InvalidArgument("rounded to steps of " + Text(grid.step) +
                         " the height field is folded; choose a smaller --step, or more --bits");
}

struct FacesReport {
  bool down = false;      // all faces look down: the mesh is to be turned over
  double steepest = 0;    // the largest slope, height by distance
  bool rounding = false;  // a face that looked up does so no more on the grid
};

// Looks at each face. Where the grid alone is to blame for a fold, there is no error, but
// report.rounding.
Result<FacesReport> LookAtFaces(const InputMesh& input, const Grid& grid, const SpoolSpace* space,
                                size_t memory_bytes) {
  const CornerTable table{&input.vertex_spool(), input.vertices(), input.vertex_bytes(),
                          input.position_bytes()};
  FacesReport report;
  bool first = true;
  const auto look = [&](const std::array<uint32_t, 3>&,
                        const std::array<const std::byte*, 3>& corners) {
    std::array<Vec3d, 3> p;
    std::array<Vec3<int64_t>, 3> q;
    for (size_t i = 0; i < 3; ++i) {
      p[i] = input.Position(corners[i]);
      q[i] = Wide(grid.Quantize(p[i]));
    }
    const Vec3d middle = (1.0 / 3) * (p[0] + p[1] + p[2]);
    const double area = AreaAbove(p[0], p[1], p[2]);
    if (area == 0) {
      return NoHeightField("a face stands upright near " + PlaceText(middle));
    }
    if (std::exchange(first, false)) report.down = area < 0;
    if ((area < 0) != report.down) {
      return NoHeightField("it is folded near " + PlaceText(middle) + ", where a face looks " +
                           (report.down ? "up and others down" : "down and others up"));
    }
    const int64_t on_grid = AreaAbove(q[0], q[1], q[2]);
    if (Sign(on_grid) != (report.down ? -1 : 1)) {
      report.rounding = true;
      return Status::Ok();
    }
    const Vec3<int64_t> normal = Cross(q[1] - q[0], q[2] - q[0]);
    report.steepest = std::max(
        report.steepest, std::hypot(static_cast<double>(normal.x), static_cast<double>(normal.y)) /
                             std::abs(static_cast<double>(on_grid)));
    return Status::Ok();
  };
  MTDB_RETURN_IF_ERROR(GatherCorners(input.triangle_spool(), table, space, memory_bytes, look));
  return report;
}

}  // namespace

Status OverlappingFaces(uint64_t edges) {
  return NoHeightField(std::to_string(edges) + " edges have more than two faces");
}

Result<double> MakeFacesLookUp(const BuildOptions& options, const SpoolSpace* space,
                               size_t memory_bytes, InputMesh* input, MeshSurvey* survey) {
  MTDB_ASSIGN_OR_RETURN(FacesReport faces, LookAtFaces(*input, survey->grid, space, memory_bytes));
  if (faces.rounding && !options.bits && !options.step) {
    BuildOptions finest = options;
    finest.bits = kFinestBits;
    MTDB_RETURN_IF_ERROR(ChooseGrid(*input, finest, space, memory_bytes, survey));
    survey->reason = GridReason::kSlivers;
    MTDB_ASSIGN_OR_RETURN(faces, LookAtFaces(*input, survey->grid, space, memory_bytes));
  }
  if (faces.rounding) return FoldedByGrid(survey->grid);
  if (faces.down) {
    MTDB_RETURN_IF_ERROR(
        input->TurnOver(space, memory_bytes / 8, [] { return Result<bool>(true); }));
  }
  return faces.steepest;
}

Status CheckHeights(InputMesh& input, const Grid& grid, const JoinOptions& join,
                    uint64_t memory_bytes) {
  BorderSweep border(memory_bytes);
  JoinTotals totals;
  const auto receive = [&](TriangleBlock block) {
    for (const TileTriangle& t : block.triangles) MTDB_RETURN_IF_ERROR(border.Add(t));
    return Status::Ok();
  };
  MTDB_RETURN_IF_ERROR(JoinCorners(input, grid, join, &totals, receive));
  if (totals.nonmanifold_edges > 0) return OverlappingFaces(totals.nonmanifold_edges);
  return border.Check(grid);
}
int64_t BorderSweep::Side(const Point& a, const Point& b, const Point& p) {
  return (int64_t{b.x} - a.x) * (int64_t{p.y} - a.y) - (int64_t{b.y} - a.y) * (int64_t{p.x} - a.x);
}

// Of two edges that do not cross, and of which none begins on the other but where it begins.
bool BorderSweep::Below::operator()(const Edge& a, const Edge& b) const {
  if (a.from == b.from) return Side(a.from, a.to, b.to) > 0;
  return a.from < b.from ? Side(a.from, a.to, b.from) > 0 : Side(b.from, b.to, a.from) < 0;
}

Status BorderSweep::Add(const TileTriangle& t) {
  // An edge, and its two events.
  if (3 * sizeof(Edge) * (edges_.size() + 3) > memory_bytes_) {
    const size_t before = edges_.size();
    Cancel();
    if (2 * edges_.size() > before) {
      return Status(StatusCode::kBudgetExceeded,
                    "the borders of the mesh have more than " + std::to_string(edges_.size()) +
                        " edges, too many to tell whether it is a height field; allow more "
                        "--memory, or join vertices of equal places with --weld=0");
    }
  }
  for (size_t i = 0; i < 3; ++i) {
    if (t.order(i) == 0) continue;
    const Vec3i& a = t.positions[i];
    const Vec3i& b = t.positions[(i + 1) % 3];
    const Point p{a.x, a.y}, q{b.x, b.y};
    edges_.push_back(p < q ? Edge{p, q, 1, 0} : Edge{q, p, -1, 0});
  }
  return Status::Ok();
}

// Edges that are there in both directions.
void BorderSweep::Cancel() {
  std::sort(edges_.begin(), edges_.end(), [](const Edge& a, const Edge& b) {
    return std::pair(a.from, a.to) < std::pair(b.from, b.to);
  });
  size_t kept = 0;
  for (const Edge& e : edges_) {
    if (kept > 0 && edges_[kept - 1].from == e.from && edges_[kept - 1].to == e.to) {
      edges_[kept - 1].winding += e.winding;
    } else {
      edges_[kept++] = e;
    }
  }
  edges_.resize(kept);
  std::erase_if(edges_, [](const Edge& e) { return e.winding == 0; });
}

bool BorderSweep::Cross(const Edge& a, const Edge& b) {
  return Sign(Side(a.from, a.to, b.from)) * Sign(Side(a.from, a.to, b.to)) < 0 &&
         Sign(Side(b.from, b.to, a.from)) * Sign(Side(b.from, b.to, a.to)) < 0;
}

BorderSweep::Point BorderSweep::Crossing(const Edge& a, const Edge& b) {
  const auto from = static_cast<double>(Side(a.from, a.to, b.from));
  const auto to = static_cast<double>(Side(a.from, a.to, b.to));
  const double part = from / (from - to);
  return {static_cast<int32_t>(b.from.x + part * (static_cast<double>(b.to.x) - b.from.x)),
          static_cast<int32_t>(b.from.y + part * (static_cast<double>(b.to.y) - b.from.y))};
}

std::vector<BorderSweep::Edge> BorderSweep::TakeEvents(Point* at) {
  std::vector<Edge> begun;
  *at = events_.top().from;
  while (!events_.empty() && events_.top().from == *at) {
    if (events_.top().winding != 0) begun.push_back(events_.top());
    events_.pop();
  }
  return begun;
}

bool BorderSweep::Begin(std::vector<Edge> edges, Active::iterator next, int32_t faces,
                        Point* fold) {
  const Point at = edges.empty() ? Point{} : edges[0].from;
  // From below to above; of those that lie on each other the shorter one first.
  std::sort(edges.begin(), edges.end(), [&](const Edge& a, const Edge& b) {
    const int64_t side = Side(at, a.to, b.to);
    return side != 0 ? side > 0 : a.to < b.to;
  });
  const auto crosses = [&](Active::iterator below, Active::iterator above) {
    if (below == active_.end() || above == active_.end() || !Cross(*below, *above)) return false;
    *fold = Crossing(*below, *above);
    return true;
  };
  Active::iterator below = next == active_.begin() ? active_.end() : std::prev(next);
  for (size_t i = 0; i < edges.size();) {
    Edge edge = edges[i++];
    for (; i < edges.size() && Side(at, edge.to, edges[i].to) == 0; ++i) {
      edge.winding += edges[i].winding;
      // What is longer goes on where this one ends.
      if (edges[i].to != edge.to) events_.push({edge.to, edges[i].to, edges[i].winding, 0});
    }
    if (edge.winding == 0) continue;
    faces += edge.winding;
    if (faces < 0 || faces > 1) {
      *fold = at;
      return false;
    }
    edge.above = faces;
    const Active::iterator added = active_.insert(next, edge);
    events_.push({edge.to, edge.to, 0, 0});
    if (crosses(below, added)) return false;
    below = added;
  }
  return !crosses(below, next);
}

Status BorderSweep::Check(const Grid& grid) {
  Cancel();
  events_ = decltype(events_)(Later{}, std::move(edges_));
  edges_.clear();
  while (!events_.empty()) {
    Point at;
    std::vector<Edge> begun = TakeEvents(&at);
    // Edges through the point end there, or go on as edges that begin there.
    Active::iterator next = active_.lower_bound(at);
    while (next != active_.end() && Side(next->from, next->to, at) == 0) {
      if (next->to != at) begun.push_back({at, next->to, next->winding, 0});
      next = active_.erase(next);
    }
    const int32_t faces = next == active_.begin() ? 0 : std::prev(next)->above;
    Point fold;
    if (!Begin(std::move(begun), next, faces, &fold)) {
      active_.clear();
      events_ = {};
      const Vec3d place = grid.Position({fold.x, fold.y, 0});
      return NoHeightField("it has two heights at places near " + Text(place.x) + ", " +
                           Text(place.y));
    }
  }
  return Status::Ok();
}

}  // namespace mtdb::internal
