// SPDX-License-Identifier: Apache-2.0
#include "query/heights.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "store/base/coordinate_limit.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

namespace {

// Relative to the numbers that enter: what rounding may move a place by.
constexpr double kSlack = 1e-12;
constexpr uint64_t kBandSamples = uint64_t{1} << 18;  // that are asked for at a time
constexpr double kMostSide = 1 << 28;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

Status CheckTerrain(const Surface& surface, const HeightOptions& options) {
  if (!IsTerrain(surface.record())) {
    return InvalidArgument(surface.record().name +
                           ": is no terrain, so it has no heights; ingest a raster");
  }
  if (std::isnan(options.error_model)) return InvalidArgument("error: expected a number");
  return Status::Ok();
}

// Of places in the object: what they are rounded by.
double SlackOf(const ObjectRecord& record) {
  const Box3d& b = record.bounds;
  return kSlack * std::max({std::abs(b.min.x), std::abs(b.max.x), std::abs(b.min.y),
                            std::abs(b.max.y), b.max.x - b.min.x});
}

// The triangles of the cut for the region, which is a part of the plane with all heights.
Result<TriangleMesh> TrianglesOver(const Surface& surface, RegionPtr region,
                                   const HeightOptions& options, HeightCost* cost) {
  Query query;
  query.region = std::move(region);
  query.threshold = ConstantThreshold(options.error_model);
  query.clip = true;
  query.control = options.control;
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  MTDB_ASSIGN_OR_RETURN(const ExtractStats stats, surface.Extract(query, sink));
  cost->clusters_read += stats.clusters_read;
  cost->bytes_read += stats.bytes_read;
  cost->error_bound = std::max(cost->error_bound, stats.error_bound);
  return mesh;
}

Triangle3d Corners(const TriangleMesh& mesh, const TriangleVertices& t) {
  return {mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
}

// Twice the area of abp seen from above.
double Side(Vec3d a, Vec3d b, double x, double y) {
  return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
}

// The height of the triangle at (x, y); none when that lies outside by more than `slack`.
std::optional<double> HeightIn(const Triangle3d& t, double x, double y, double slack) {
  std::array<double, 3> weight{};
  double sum = 0;
  for (size_t i = 0; i < 3; ++i) {
    const Vec3d a = t[(i + 1) % 3];
    const Vec3d b = t[(i + 2) % 3];
    weight[i] = Side(a, b, x, y);
    const double edge = std::hypot(b.x - a.x, b.y - a.y);
    if (weight[i] < -slack * edge) return std::nullopt;
    if (std::abs(weight[i]) <= slack * edge) weight[i] = 0;
    sum += weight[i];
  }
  if (!(sum > 0)) return std::nullopt;
  double height = 0;
  for (size_t i = 0; i < 3; ++i) {
    if (weight[i] == sum) return t[i].z;  // a corner: no rounding
    height += weight[i] / sum * t[i].z;
  }
  return height;
}

Box3d AllHeights(const ObjectRecord& record, double min_x, double min_y, double max_x,
                 double max_y) {
  const double margin = 1 + std::abs(record.bounds.min.z) + std::abs(record.bounds.max.z);
  return {{min_x, min_y, record.bounds.min.z - margin},
          {max_x, max_y, record.bounds.max.z + margin}};
}

// Where the segment from a lies over a triangle, by the part of it, and the heights there.
struct Stretch {
  double begin = 0, end = 0;
  double begin_height = 0, end_height = 0;
};

std::optional<Stretch> StretchOver(const Triangle3d& t, std::array<double, 2> a,
                                   std::array<double, 2> b) {
  double begin = 0;
  double end = 1;
  for (size_t i = 0; i < 3; ++i) {
    const double from = Side(t[i], t[(i + 1) % 3], a[0], a[1]);
    const double to = Side(t[i], t[(i + 1) % 3], b[0], b[1]);
    if (from < 0 && to < 0) return std::nullopt;
    if (from < 0) begin = std::max(begin, from / (from - to));
    if (to < 0) end = std::min(end, from / (from - to));
  }
  if (!(begin < end)) return std::nullopt;
  const double area = Side(t[0], t[1], t[2].x, t[2].y);
  if (!(area > 0)) return std::nullopt;
  const auto height = [&](double part) {
    const double x = a[0] + part * (b[0] - a[0]);
    const double y = a[1] + part * (b[1] - a[1]);
    return (Side(t[1], t[2], x, y) * t[0].z + Side(t[2], t[0], x, y) * t[1].z +
            Side(t[0], t[1], x, y) * t[2].z) /
           area;
  };
  return Stretch{begin, end, height(begin), height(end)};
}

// The part of a segment that may lie over the terrain. False: none.
bool ClipToBounds(const Box3d& bounds, double margin, std::array<double, 2> a,
                  std::array<double, 2> b, double* begin, double* end) {
  *begin = 0;
  *end = 1;
  for (int axis = 0; axis < 2; ++axis) {
    const auto i = static_cast<size_t>(axis);
    const double low = bounds.min[axis] - margin - a[i];
    const double high = bounds.max[axis] + margin - a[i];
    const double d = b[i] - a[i];
    if (d == 0) {
      if (low > 0 || high < 0) return false;
      continue;
    }
    *begin = std::max(*begin, std::min(low / d, high / d));
    *end = std::min(*end, std::max(low / d, high / d));
  }
  return *begin < *end;
}

// Appends the points of one segment, whose first corner lies `before` along the line. `same`:
// crossings of one edge, by two triangles, are so near to each other, as parts of the segment.
void AppendSegment(std::vector<Stretch> stretches, std::array<double, 2> a, std::array<double, 2> b,
                   double before, double same, std::vector<ProfilePoint>* points) {
  std::sort(stretches.begin(), stretches.end(), [](const Stretch& s, const Stretch& t) {
    return s.begin != t.begin ? s.begin < t.begin : s.end < t.end;
  });
  const double length = std::hypot(b[0] - a[0], b[1] - a[1]);
  const auto add = [&](double part, std::optional<double> height) {
    const double distance = before + part * length;
    if (!points->empty()) {
      const ProfilePoint& last = points->back();
      const bool here = distance - last.distance <= same * length;
      if (here && last.height.has_value() == height.has_value()) return;
      if (here && !last.height) points->pop_back();
    }
    points->push_back({distance, a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), height});
  };
  double done = 0;
  bool covered = false;  // at `done`
  for (const Stretch& s : stretches) {
    if (s.end <= done + same && covered) continue;
    if (s.begin > done + same || !covered) {
      if (s.begin > done + same) add(done, std::nullopt);
      add(s.begin, s.begin_height);
    }
    add(s.end, s.end_height);
    done = s.end;
    covered = true;
  }
  if (done < 1 - same) {
    add(done, std::nullopt);
  }
}

// The prism over a strip around the segment that is as wide as rounding.
RegionPtr Strip(std::array<double, 2> a, std::array<double, 2> b, double slack) {
  const double length = std::hypot(b[0] - a[0], b[1] - a[1]);
  const double x = (b[0] - a[0]) / length * 4 * slack;
  const double y = (b[1] - a[1]) / length * 4 * slack;
  return PrismRegion({{a[0] - x + y, a[1] - y - x},
                      {b[0] + x + y, b[1] + y - x},
                      {b[0] + x - y, b[1] + y + x},
                      {a[0] - x - y, a[1] - y + x}});
}

// Answers places, which are numbered by `order`, a group after the other.
class HeightFinder {
 public:
  HeightFinder(const Surface& surface, std::span<const std::array<double, 2>> places,
               const HeightOptions& options)
      : surface_(surface),
        places_(places),
        options_(options),
        slack_(SlackOf(surface.record())),
        answers_(places.size()) {}

  Status Find(std::span<uint32_t> order) {
    if (order.empty()) return Status::Ok();
    Box3d box;
    for (const uint32_t i : order) box.Add(Vec3d{places_[i][0], places_[i][1], 0});
    const double triangles = TrianglesIn(box);
    const double enough =
        std::min(kMostTriangles, kTrianglesPerPlace * static_cast<double>(order.size()));
    if (order.size() > 1 && triangles > enough) {
      const int axis = box.max.x - box.min.x > box.max.y - box.min.y ? 0 : 1;
      const auto middle = order.begin() + static_cast<std::ptrdiff_t>(order.size() / 2);
      std::nth_element(order.begin(), middle, order.end(), [&](uint32_t a, uint32_t b) {
        return places_[a][static_cast<size_t>(axis)] < places_[b][static_cast<size_t>(axis)];
      });
      const auto half = static_cast<size_t>(middle - order.begin());
      MTDB_RETURN_IF_ERROR(Find(order.first(half)));
      return Find(order.subspan(half));
    }
    return FindTogether(order, box);
  }
  std::vector<HeightAnswer> TakeAnswers() { return std::move(answers_); }
  const HeightCost& cost() const { return cost_; }

 private:
  // A query of its own reads about as many.
  static constexpr double kTrianglesPerPlace = 256;
  static constexpr double kMostTriangles = 1 << 18;  // in memory at a time

  // About how many there are, at full resolution; beyond the bounds there are none.
  double TrianglesIn(const Box3d& box) const {
    const ObjectRecord& record = surface_.record();
    double part = 1;
    for (int axis = 0; axis < 2; ++axis) {
      const double low = std::max(box.min[axis], record.bounds.min[axis]);
      const double high = std::min(box.max[axis], record.bounds.max[axis]);
      const double size = record.bounds.max[axis] - record.bounds.min[axis];
      part *= size > 0 ? std::max(0.0, high - low) / size : 1;
    }
    return part * static_cast<double>(record.triangles);
  }

  Status FindTogether(std::span<uint32_t> order, const Box3d& box) {
    HeightCost cost;
    const Box3d around = AllHeights(surface_.record(), box.min.x - slack_, box.min.y - slack_,
                                    box.max.x + slack_, box.max.y + slack_);
    MTDB_ASSIGN_OR_RETURN(const TriangleMesh mesh,
                          TrianglesOver(surface_, BoxRegion(around), options_, &cost));
    std::sort(order.begin(), order.end(),
              [&](uint32_t a, uint32_t b) { return places_[a][0] < places_[b][0]; });
    for (const TriangleVertices& t : mesh.triangles) {
      const Triangle3d corners = Corners(mesh, t);
      const auto [least, most] = std::minmax({corners[0].x, corners[1].x, corners[2].x});
      auto i = std::lower_bound(order.begin(), order.end(), least - slack_,
                                [&](uint32_t place, double x) { return places_[place][0] < x; });
      for (; i != order.end() && places_[*i][0] <= most + slack_; ++i) {
        std::optional<double>& height = answers_[*i].height;
        if (!height) height = HeightIn(corners, places_[*i][0], places_[*i][1], slack_);
      }
    }
    for (const uint32_t i : order) answers_[i].cost.error_bound = cost.error_bound;
    cost_.error_bound = std::max(cost_.error_bound, cost.error_bound);
    cost_.clusters_read += cost.clusters_read;
    cost_.bytes_read += cost.bytes_read;
    return Status::Ok();
  }

  const Surface& surface_;
  const std::span<const std::array<double, 2>> places_;
  const HeightOptions& options_;
  const double slack_;
  std::vector<HeightAnswer> answers_;
  HeightCost cost_;
};

Result<std::vector<HeightAnswer>> HeightsAt(const Surface& surface,
                                            std::span<const std::array<double, 2>> places,
                                            const HeightOptions& options, HeightCost* cost) {
  MTDB_RETURN_IF_ERROR(CheckTerrain(surface, options));
  if (places.size() > std::numeric_limits<uint32_t>::max()) {
    return InvalidArgument("heights: expected fewer than 2^32 places");
  }
  std::vector<uint32_t> order(places.size());
  for (uint32_t i = 0; i < order.size(); ++i) {
    order[i] = i;
    if (!AreCoordinates({places[i][0], places[i][1], 0})) {
      return InvalidArgument("height: expected coordinates from -1e30 to 1e30");
    }
  }
  HeightFinder finder(surface, places, options);
  MTDB_RETURN_IF_ERROR(finder.Find(order));
  *cost = finder.cost();
  return finder.TakeAnswers();
}

Result<HeightAnswer> HeightAt(const Surface& surface, double x, double y,
                              const HeightOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckTerrain(surface, options));
  if (!std::isfinite(x) || !std::isfinite(y)) {
    return InvalidArgument("height: expected finite coordinates");
  }
  const double slack = SlackOf(surface.record());
  HeightAnswer answer;
  const Box3d place = AllHeights(surface.record(), x - slack, y - slack, x + slack, y + slack);
  MTDB_ASSIGN_OR_RETURN(const TriangleMesh mesh,
                        TrianglesOver(surface, BoxRegion(place), options, &answer.cost));
  for (const TriangleVertices& t : mesh.triangles) {
    answer.height = HeightIn(Corners(mesh, t), x, y, slack);
    if (answer.height) break;
  }
  return answer;
}

std::array<double, 2> Part(std::array<double, 2> a, std::array<double, 2> b, double part) {
  if (part == 0) return a;
  if (part == 1) return b;
  return {a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])};
}

// Of a segment.
Result<std::vector<Stretch>> StretchesOver(const Surface& surface, std::array<double, 2> a,
                                           std::array<double, 2> b, double slack,
                                           const HeightOptions& options, HeightCost* cost) {
  std::vector<Stretch> stretches;
  // What is left of a line that touches a corner of the bounds.
  if (!(std::hypot(b[0] - a[0], b[1] - a[1]) > slack)) return stretches;
  MTDB_ASSIGN_OR_RETURN(const TriangleMesh mesh,
                        TrianglesOver(surface, Strip(a, b, slack), options, cost));
  for (const TriangleVertices& t : mesh.triangles) {
    if (const auto s = StretchOver(Corners(mesh, t), a, b)) stretches.push_back(*s);
  }
  return stretches;
}

Result<Profile> ProfileAlong(const Surface& surface, std::span<const std::array<double, 2>> corners,
                             const HeightOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckTerrain(surface, options));
  if (corners.size() < 2) return InvalidArgument("line: expected two corners or more");
  const double slack = SlackOf(surface.record());
  Profile profile;
  double before = 0;
  for (size_t i = 0; i + 1 < corners.size(); ++i) {
    const std::array<double, 2> a = corners[i];
    const std::array<double, 2> b = corners[i + 1];
    const double length = std::hypot(b[0] - a[0], b[1] - a[1]);
    if (!std::isfinite(length) || !(length > slack)) {
      return InvalidArgument("line: corners " + std::to_string(i) + " and " +
                             std::to_string(i + 1) + ": expected different finite places");
    }
    // Beyond, places along the line are not known to a millionth of the terrain's size.
    constexpr double kMostDiagonals = 4e9;
    if (length > kMostDiagonals * surface.record().diagonal()) {
      return InvalidArgument("line: corners " + std::to_string(i) + " and " +
                             std::to_string(i + 1) +
                             " are too far apart for exact places between them; name corners that "
                             "are nearer to the terrain");
    }
    std::vector<Stretch> stretches;
    double begin = 0, end = 1;
    if (ClipToBounds(surface.record().bounds, 16 * slack, a, b, &begin, &end)) {
      MTDB_ASSIGN_OR_RETURN(stretches, StretchesOver(surface, Part(a, b, begin), Part(a, b, end),
                                                     slack, options, &profile.cost));
      for (Stretch& s : stretches) {
        s.begin = begin + s.begin * (end - begin);
        s.end = begin + s.end * (end - begin);
      }
    } else {
      begin = 0, end = 1;
    }
    constexpr double kSame = 1e-10;
    AppendSegment(std::move(stretches), a, b, before, kSame * (end - begin), &profile.points);
    before += length;
  }
  return profile;
}

// Writes the heights of the samples in one triangle.
void SampleTriangle(const Triangle3d& t, const HeightRaster& raster, uint32_t begin, uint32_t end,
                    double slack, std::vector<double>& heights) {
  const auto [min_x, max_x] = std::minmax({t[0].x, t[1].x, t[2].x});
  const auto [min_y, max_y] = std::minmax({t[0].y, t[1].y, t[2].y});
  const auto range = [](double least, double most, double first, double step, double from,
                        double to) {
    double low = (least - first) / step;
    double high = (most - first) / step;
    if (low > high) std::swap(low, high);
    constexpr double kRound = 1e-6;
    return std::pair{std::max(from, std::ceil(low - kRound)),
                     std::min(to, std::floor(high + kRound))};
  };
  const auto [first_column, last_column] =
      range(min_x, max_x, raster.x0, raster.dx, 0, raster.columns - 1.0);
  const auto [first_row, last_row] = range(min_y, max_y, raster.y0, raster.dy, begin, end - 1.0);
  for (double row = first_row; row <= last_row; ++row) {
    for (double column = first_column; column <= last_column; ++column) {
      const auto height =
          HeightIn(t, raster.x0 + column * raster.dx, raster.y0 + row * raster.dy, slack);
      if (!height) continue;
      heights[static_cast<size_t>(row - begin) * raster.columns + static_cast<size_t>(column)] =
          *height;
    }
  }
}

Result<std::vector<double>> SampleRows(const Surface& surface, const HeightRaster& raster,
                                       uint32_t begin, uint32_t end, const HeightOptions& options,
                                       HeightCost* cost) {
  MTDB_RETURN_IF_ERROR(CheckTerrain(surface, options));
  if (raster.columns == 0 || begin >= end || end > raster.rows || raster.dx == 0 ||
      raster.dy == 0 || !std::isfinite(raster.x0 + raster.columns * raster.dx) ||
      !std::isfinite(raster.y0 + raster.rows * raster.dy)) {
    return InvalidArgument("raster: expected columns, rows, and finite spacings other than 0");
  }
  const double slack = SlackOf(surface.record());
  const double x1 = raster.x0 + (raster.columns - 1) * raster.dx;
  const double y0 = raster.y0 + begin * raster.dy;
  const double y1 = raster.y0 + (end - 1) * raster.dy;
  const Box3d box =
      AllHeights(surface.record(), std::min(raster.x0, x1) - slack, std::min(y0, y1) - slack,
                 std::max(raster.x0, x1) + slack, std::max(y0, y1) + slack);
  MTDB_ASSIGN_OR_RETURN(const TriangleMesh mesh,
                        TrianglesOver(surface, BoxRegion(box), options, cost));
  std::vector<double> heights(size_t{end - begin} * raster.columns, kNone);
  for (const TriangleVertices& t : mesh.triangles) {
    SampleTriangle(Corners(mesh, t), raster, begin, end, slack, heights);
  }
  return heights;
}

}  // namespace

bool IsTerrain(const ObjectRecord& record) {
  return record.error_measure == ErrorMeasure::kVertical;
}

Result<HeightAnswer> FindHeight(const Surface& surface, double x, double y,
                                const HeightOptions& options) {
  return CatchOutOfMemory([&] { return HeightAt(surface, x, y, options); });
}

Result<std::vector<HeightAnswer>> FindHeights(const Surface& surface,
                                              std::span<const std::array<double, 2>> places,
                                              const HeightOptions& options, HeightCost* cost) {
  return CatchOutOfMemory([&] { return HeightsAt(surface, places, options, cost); });
}

Result<Profile> FindProfile(const Surface& surface, std::span<const std::array<double, 2>> corners,
                            const HeightOptions& options) {
  return CatchOutOfMemory([&] { return ProfileAlong(surface, corners, options); });
}

Result<std::vector<double>> SampleHeights(const Surface& surface, const HeightRaster& raster,
                                          uint32_t begin, uint32_t end,
                                          const HeightOptions& options, HeightCost* cost) {
  return CatchOutOfMemory([&] { return SampleRows(surface, raster, begin, end, options, cost); });
}

Result<HeightRaster> RasterSamples(const ObjectRecord& record,
                                   const std::optional<std::array<double, 4>>& window,
                                   const std::optional<std::array<double, 2>>& spacing) {
  if (!IsTerrain(record)) {
    return InvalidArgument(record.name + ": is no terrain, so it is no raster either");
  }
  if (!record.raster && !spacing) {
    return InvalidArgument(record.name +
                           ": was a mesh, so it has no samples of its own; name a spacing");
  }
  const RasterFrame f = record.raster.value_or(RasterFrame{});
  const auto& g = f.geotransform;
  const double half = f.transform_of_samples ? 0 : 0.5;
  HeightRaster own{g[0] + half * g[1], g[3] + half * g[5], g[1], g[5], f.columns, f.rows};
  const bool turned = !record.raster || g[2] != 0 || g[4] != 0 || !(g[1] > 0 && g[5] < 0);
  if (turned && !spacing) {
    return InvalidArgument(record.name +
                           ": its rows do not run from west to east and from north to south; name "
                           "a spacing, and samples that do are computed");
  }
  HeightRaster r = own;
  const Box3d& b = record.bounds;
  if (spacing) {
    if (!((*spacing)[0] > 0 && (*spacing)[1] > 0 && std::isfinite((*spacing)[0]) &&
          std::isfinite((*spacing)[1]))) {
      return InvalidArgument("spacing: expected two numbers above 0");
    }
    r.dx = (*spacing)[0];
    r.dy = -(*spacing)[1];
    if (turned) r.x0 = b.min.x, r.y0 = b.max.y;
  }
  const std::array<double, 4> wanted =
      window.value_or(std::array<double, 4>{b.min.x, b.min.y, b.max.x, b.max.y});
  constexpr double kRound = 1e-6;
  const bool all = !window && !spacing;
  const double first_column = all ? 0 : std::ceil((wanted[0] - r.x0) / r.dx - kRound);
  const double first_row = all ? 0 : std::ceil((wanted[3] - r.y0) / r.dy - kRound);
  const double columns =
      all ? f.columns : std::floor((wanted[2] - r.x0) / r.dx + kRound) - first_column + 1;
  const double rows = all ? f.rows : std::floor((wanted[1] - r.y0) / r.dy + kRound) - first_row + 1;
  if (!(columns >= 1 && rows >= 1)) {
    return InvalidArgument("window: no sample lies in it");
  }
  if (!(columns <= kMostSide && rows <= kMostSide)) {
    return InvalidArgument(
        "the raster would have more than 2^28 columns or rows; choose a larger "
        "spacing");
  }
  r.x0 += first_column * r.dx;
  r.y0 += first_row * r.dy;
  r.columns = static_cast<uint32_t>(columns);
  r.rows = static_cast<uint32_t>(rows);
  return r;
}

Status VisitHeights(const Surface& surface, const HeightRaster& raster,
                    const HeightOptions& options, HeightCost* cost,
                    const std::function<Status(std::span<const double> rows)>& visit) {
  const uint64_t band = std::max<uint64_t>(1, kBandSamples / std::max(1u, raster.columns));
  for (uint64_t begin = 0; begin < raster.rows; begin += band) {
    const uint64_t end = std::min<uint64_t>(raster.rows, begin + band);
    MTDB_ASSIGN_OR_RETURN(const std::vector<double> heights,
                          SampleHeights(surface, raster, static_cast<uint32_t>(begin),
                                        static_cast<uint32_t>(end), options, cost));
    MTDB_RETURN_IF_ERROR(visit(heights));
  }
  return Status::Ok();
}

}  // namespace mtdb
