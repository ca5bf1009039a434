// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/question.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/camera.h"

namespace mtdb::everything {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kFovDegrees = 40;

// A region in each language. `depth` is positive inside, where it is at most the distance to all
// that is outside, and negative outside, where it is at least minus the distance.
struct RegionText {
  Json json;
  std::optional<Arguments> option;
  RegionPtr region;
  std::function<double(Vec3d)> depth;
};

Json Point(Vec3d p) { return Json::array({p.x, p.y, p.z}); }

std::string List(const std::vector<double>& numbers) {
  std::string text;
  for (const double n : numbers) text += (text.empty() ? "" : ",") + NumberText(n);
  return text;
}

double BoxDepth(const Box3d& box, Vec3d p) {
  const double outside = std::sqrt(SquaredDistancePointBox(p, box));
  if (outside > 0) return -outside;
  double depth = kInfinity;
  for (int i = 0; i < 3; ++i) depth = std::min({depth, p[i] - box.min[i], box.max[i] - p[i]});
  return depth;
}

RegionText MakeBox(Vec3d c, double r) {
  const Vec3d half{r, 0.7 * r, 1.3 * r};
  const Box3d box{c - half, c + half};
  return {{{"box", {{"min", Point(box.min)}, {"max", Point(box.max)}}}},
          Arguments{"--box=" +
                    List({box.min.x, box.min.y, box.min.z, box.max.x, box.max.y, box.max.z})},
          BoxRegion(box),
          [=](Vec3d p) { return BoxDepth(box, p); }};
}

RegionText MakeSphere(Vec3d c, double r) {
  return {{{"sphere", {{"centre", Point(c)}, {"radius", r}}}},
          Arguments{"--sphere=" + List({c.x, c.y, c.z, r})},
          SphereRegion(c, r),
          [=](Vec3d p) { return r - Length(p - c); }};
}

RegionText MakeHalfSpace(Vec3d c, double) {
  const Vec3d n{1, 2, -1};
  return {{{"half_space", {{"point", Point(c)}, {"normal", Point(n)}}}},
          Arguments{"--half-space=" + List({c.x, c.y, c.z, n.x, n.y, n.z})},
          HalfSpaceRegion({c, n}),
          [=](Vec3d p) { return -Dot(p - c, n) / Length(n); }};
}

// A wedge between two planes, and a third: not bounded.
RegionText MakePolyhedron(Vec3d c, double r) {
  const std::vector<HalfSpace> planes{
      {c, {-1, -1, 0}}, {c, {1, -1, 0.5}}, {c + Vec3d{0, 2 * r, 0}, {0, 1, 0.2}}};
  Json list = Json::array();
  for (const HalfSpace& h : planes) {
    list.push_back({{"point", Point(h.point)}, {"normal", Point(h.normal)}});
  }
  return {{{"polyhedron", list}}, std::nullopt, ConvexRegion(planes), [=](Vec3d p) {
            double depth = kInfinity;
            for (const HalfSpace& h : planes) {
              depth = std::min(depth, -Dot(p - h.point, h.normal) / Length(h.normal));
            }
            return depth;
          }};
}

RegionText MakePrism(Vec3d c, double r) {
  const double x = 1.2 * r, y = 0.6 * r;
  const Box3d box{{c.x - x, c.y - y, -kInfinity}, {c.x + x, c.y + y, kInfinity}};
  const std::vector<std::array<double, 2>> corners{{box.min.x, box.min.y},
                                                   {box.max.x, box.min.y},
                                                   {box.max.x, box.max.y},
                                                   {box.min.x, box.max.y}};
  std::vector<double> numbers;
  for (const auto& corner : corners) numbers.insert(numbers.end(), corner.begin(), corner.end());
  return {{{"prism", {{"polygon", corners}}}},
          Arguments{"--prism=" + List(numbers)},
          PrismRegion(corners),
          [=](Vec3d p) {
            return BoxDepth({{box.min.x, box.min.y, -1e300}, {box.max.x, box.max.y, 1e300}},
                            {p.x, p.y, 0});
          }};
}

RegionText MakePoint(Vec3d c, double) {
  return {{{"point", Point(c)}},
          Arguments{"--point=" + List({c.x, c.y, c.z})},
          PointRegion(c),
          [=](Vec3d p) { return -Length(p - c); }};
}

RegionText MakeSegment(Vec3d c, double r) {
  const Vec3d a = c - Vec3d{r, r, 0}, b = c + Vec3d{r, r, 0.5 * r};
  return {{{"segment", {{"from", Point(a)}, {"to", Point(b)}}}},
          Arguments{"--segment=" + List({a.x, a.y, a.z, b.x, b.y, b.z})},
          SegmentRegion(a, b),
          [=](Vec3d p) { return -std::sqrt(SquaredDistancePointSegment(p, a, b)); }};
}

RegionText MakeTube(Vec3d c, double r) {
  const double wide = 0.3 * r;
  const std::vector<Vec3d> line{c - Vec3d{r, 0, 0}, c + Vec3d{0, r, 0}, c + Vec3d{r, 0, r}};
  Json points = Json::array();
  std::vector<double> numbers{wide};
  for (const Vec3d& p : line) {
    points.push_back(Point(p));
    numbers.insert(numbers.end(), {p.x, p.y, p.z});
  }
  return {{{"tube", {{"line", points}, {"radius", wide}}}},
          Arguments{"--tube=" + List(numbers)},
          TubeRegion(line, wide),
          [=](Vec3d p) {
            return wide - std::sqrt(std::min(SquaredDistancePointSegment(p, line[0], line[1]),
                                             SquaredDistancePointSegment(p, line[1], line[2])));
          }};
}

// A camera that looks at c from afar, aslant.
Camera CameraAt(Vec3d c, double r) {
  Camera camera;
  camera.direction = {0.3, 1, -0.6};
  camera.eye = c - camera.direction * (2 * r);
  camera.vertical_fov_rad = kFovDegrees * (std::acos(-1.0) / 180);
  camera.width_px = 800;
  camera.height_px = 600;
  return camera;
}
Json CameraJson(const Camera& camera) {
  return {{"eye", Point(camera.eye)},
          {"direction", Point(camera.direction)},
          {"fov", kFovDegrees},
          {"viewport", {camera.width_px, camera.height_px}}};
}

RegionText MakeFrustum(Vec3d c, double r) {
  const Camera camera = CameraAt(c, r);
  const Vec3d target = camera.eye + camera.direction;
  const Vec3d forward = camera.direction * (1 / Length(camera.direction));
  const Vec3d side = Cross(forward, Vec3d{0, 0, 1});
  const Vec3d right = side * (1 / Length(side));
  const Vec3d up = Cross(right, forward);
  const double ty = std::tan(camera.vertical_fov_rad / 2), tx = ty * 800 / 600;
  Arguments option{"--frustum", "--eye=" + List({camera.eye.x, camera.eye.y, camera.eye.z}),
                   "--target=" + List({target.x, target.y, target.z}),
                   "--fov=" + NumberText(kFovDegrees), "--viewport=800x600"};
  // The target as the difference that the command line's reader takes.
  Camera seen = camera;
  seen.direction = target - camera.eye;
  Json json = CameraJson(camera);
  json.erase("direction");
  json["target"] = Point(target);
  return {
      {{"frustum", json}}, option, FrustumRegion(seen), [=, eye = camera.eye](Vec3d p) {
        const double z = Dot(p - eye, forward);
        const double x = std::abs(Dot(p - eye, right)), y = std::abs(Dot(p - eye, up));
        return std::min({z, (tx * z - x) / std::hypot(1, tx), (ty * z - y) / std::hypot(1, ty)});
      }};
}

// What lies above and below a camera's frustum: a convex polygon.
RegionText MakeShadow(Vec3d c, double r) {
  Camera camera = CameraAt(c, r);
  camera.near = r;
  camera.far = 3 * r;
  const Camera::Axes axes = camera.axes();
  std::vector<Vec3d> corners;
  for (const double z : {camera.near, camera.far}) {
    for (const double x : {-1.0, 1.0}) {
      for (const double y : {-1.0, 1.0}) {
        corners.push_back(camera.eye + axes.forward * z +
                          axes.right * (x * z * camera.tangent_x()) +
                          axes.up * (y * z * camera.tangent_y()));
      }
    }
  }
  Json json = CameraJson(camera);
  json["near"] = camera.near;
  json["far"] = camera.far;
  // Of each line through two corners with all others on one side, the side.
  struct Line {
    double x, y, nx, ny;
  };
  std::vector<Line> lines;
  for (const Vec3d& a : corners) {
    for (const Vec3d& b : corners) {
      const double length = std::hypot(b.x - a.x, b.y - a.y);
      if (!(length > 1e-9 * r)) continue;
      const Line line{a.x, a.y, (b.y - a.y) / length, (a.x - b.x) / length};
      const bool all_left = std::ranges::all_of(corners, [&](Vec3d p) {
        return (p.x - line.x) * line.nx + (p.y - line.y) * line.ny <= 1e-9 * r;
      });
      if (all_left) lines.push_back(line);
    }
  }
  return {{{"frustum_shadow", json}}, std::nullopt, FrustumShadowRegion(camera), [=](Vec3d p) {
            double depth = kInfinity;
            for (const Line& l : lines) {
              depth = std::min(depth, -((p.x - l.x) * l.nx + (p.y - l.y) * l.ny));
            }
            return depth;
          }};
}

RegionText MakeWedge(Vec3d c, double r) {
  constexpr double kDegrees = 50;
  const double half = kDegrees / 2 * (std::acos(-1.0) / 180);
  const Wedge wedge{c.x - r, c.y, 1, 0.25, 2 * half, 0, 2 * r};
  const double length = std::hypot(wedge.direction_x, wedge.direction_y);
  const double dx = wedge.direction_x / length, dy = wedge.direction_y / length;
  return {{{"wedge",
            {{"apex", {wedge.apex_x, wedge.apex_y}},
             {"direction", {wedge.direction_x, wedge.direction_y}},
             {"angle", kDegrees},
             {"far", wedge.far}}}},
          Arguments{"--wedge=" + List({wedge.apex_x, wedge.apex_y, wedge.direction_x,
                                       wedge.direction_y, kDegrees, wedge.far})},
          WedgeRegion(wedge),
          [=](Vec3d p) {
            const double x = p.x - wedge.apex_x, y = p.y - wedge.apex_y;
            const double along = x * dx + y * dy, aside = std::abs(x * dy - y * dx);
            return std::min(wedge.far - along, along * std::sin(half) - aside * std::cos(half));
          }};
}

struct RegionKind {
  const char* name;
  RegionText (*make)(Vec3d middle, double size);
};
constexpr RegionKind kRegions[] = {
    {"box", MakeBox},     {"sphere", MakeSphere},         {"half-space", MakeHalfSpace},
    {"prism", MakePrism}, {"point", MakePoint},           {"segment", MakeSegment},
    {"tube", MakeTube},   {"polyhedron", MakePolyhedron}, {"frustum", MakeFrustum},
    {"wedge", MakeWedge}, {"shadow", MakeShadow},
};

RegionText MakeRegion(const std::string& name, const std::string& at, double r,
                      const Truth& truth) {
  std::vector<double> where = Numbers(at);
  where.resize(3, 0.5);
  const Vec3d size = truth.bounds.max - truth.bounds.min;
  Vec3d c;
  for (int i = 0; i < 3; ++i) {
    c[i] = truth.bounds.min[i] + size[i] * where[static_cast<size_t>(i)];
  }
  // A mesh may lie in one place.
  const double size_of_all = truth.diagonal() > 0 ? truth.diagonal() : 1;
  for (const RegionKind& k : kRegions) {
    if (name == k.name) return k.make(c, r * size_of_all);
  }
  return kRegions[0].make(c, r * size_of_all);
}

RegionText Combined(const Step& step, const Truth& truth) {
  RegionText one = MakeRegion(step.Text("region"), step.Text("at"), step.Number("r", 0.2), truth);
  if (step.has("region2")) {
    RegionText two =
        MakeRegion(step.Text("region2"), step.Text("at2"), step.Number("r2", 0.1), truth);
    const bool all = step.Text("combine") == "intersection";
    // The command line has one camera.
    if (step.Text("region") == "frustum" && step.Text("region2") == "frustum") two.option.reset();
    RegionText both;
    both.json = {{all ? "intersection" : "union", Json::array({one.json, two.json})}};
    if (one.option && two.option) {
      both.option = one.option;
      both.option->insert(both.option->end(), two.option->begin(), two.option->end());
      if (all) both.option->push_back("--intersect");
    }
    both.region =
        all ? IntersectionRegion({one.region, two.region}) : UnionRegion({one.region, two.region});
    both.depth = [=, a = one.depth, b = two.depth](Vec3d p) {
      return all ? std::min(a(p), b(p)) : std::max(a(p), b(p));
    };
    one = both;
  }
  if (step.Flag("outside")) {
    one.json = {{"outside", one.json}};
    if (one.option) one.option->push_back("--outside");
    one.region = ComplementRegion(one.region);
    one.depth = [inner = one.depth](Vec3d p) { return -inner(p); };
  }
  return one;
}

// Adds what the command line says of something, if it can.
void AddOptions(std::optional<Arguments>* all, const std::optional<Arguments>& more) {
  if (!more) all->reset();
  if (*all) (*all)->insert((*all)->end(), more->begin(), more->end());
}

void SetConstant(Question* q, double error) {
  q->permitted_everywhere = error;
  q->permitted = [=](Vec3d) { return error; };
  q->query.threshold = ConstantThreshold(error);
}

// What thresholds look at: the middle, or where `focus` says, as `at` does.
Vec3d FocusOf(const Step& step, const Truth& truth) {
  std::vector<double> where = Numbers(step.Text("focus"));
  where.resize(3, 0.5);
  const Vec3d size = truth.bounds.max - truth.bounds.min;
  Vec3d c = (truth.bounds.min + truth.bounds.max) * 0.5;
  for (int i = 0; i < 3; ++i) c[i] += size[i] * (where[static_cast<size_t>(i)] - 0.5);
  return c;
}

// Functions of the distance from the focus.
void SetCurve(const Step& step, const Truth& truth, const std::string& kind, double error,
              Question* q) {
  const Vec3d c = FocusOf(step, truth);
  const double d = std::max(truth.diagonal(), 1e-25);  // queries have no larger factors
  const double slope = step.Number("slope", 0.05);
  std::function<double(double)> of;
  std::string name = kind;
  double factor = 0;
  if (kind == "quadratic") {
    factor = slope / d;
    of = [=](double r) { return error + factor * r * r; };
    q->query.threshold = QuadraticThreshold(c, error, factor);
  } else if (kind == "sqrt") {
    factor = slope * std::sqrt(d);
    of = [=](double r) { return error + factor * std::sqrt(r); };
    q->query.threshold = SquareRootThreshold(c, error, factor);
    name = "square_root";
  } else {
    factor = 20 * slope / d;
    of = [=](double r) { return error * std::exp(factor * r); };
    q->query.threshold = ExponentialThreshold(c, error, factor);
    name = "exponential";
  }
  q->json["threshold"] = {
      {name, {{"point", Point(c)}, {"base", error}, {kind == "exp" ? "rate" : "factor", factor}}}};
  AddOptions(&q->options,
             Arguments{"--error-at=" + kind + "," + List({c.x, c.y, c.z, error, factor})});
  q->permitted = [=](Vec3d p) { return std::max(0.0, of(Length(p - c))); };
  q->partly_full = kind != "exp" && slope < 0;
}

// Two by two by one cells, over half of the object and to infinity.
void SetGrid(const Truth& truth, double error, double error2, Question* q) {
  GridField field;
  const Vec3d size = truth.bounds.max - truth.bounds.min;
  const double least = std::max(1e-3 * truth.diagonal(), 1e-290);
  field.origin = truth.bounds.min + size * 0.25;
  for (int i = 0; i < 3; ++i) field.cell_size[i] = std::max(size[i] * 0.25, least);
  field.counts = {2, 2, 1};
  field.errors = {error, error2, std::max(error, error2), std::min(error, error2) / 2};
  q->json["threshold"] = {{"grid",
                           {{"origin", Point(field.origin)},
                            {"cell", Point(field.cell_size)},
                            {"counts", {2, 2, 1}},
                            {"errors", field.errors}}}};
  AddOptions(&q->options, std::nullopt);
  q->query.threshold = GridThreshold(field);
  // On a face, which rounding may put on either side, the larger one will do.
  const double border = 1e-9 * (truth.diagonal() + Length(truth.bounds.max));
  q->permitted = [=](Vec3d p) {
    double most = 0;
    for (size_t y = 0; y < 2; ++y) {
      for (size_t x = 0; x < 2; ++x) {
        const double fx = p.x - (field.origin.x + field.cell_size.x);
        const double fy = p.y - (field.origin.y + field.cell_size.y);
        if ((x == 0 ? fx : -fx) > border || (y == 0 ? fy : -fy) > border) continue;
        most = std::max(most, field.errors[2 * y + x]);
      }
    }
    return most;
  };
}

void SetThreshold(const Step& step, const Truth& truth, double diagonal,
                  const std::optional<RegionText>& region, Question* q) {
  const std::string kind = step.Text("threshold", "full");
  const double error = step.Number("error", 0.01) * truth.diagonal();
  const double error2 = step.Number("error2", 0.1) * truth.diagonal();
  if (kind == "constant") {
    q->json["threshold"] = error;
    AddOptions(&q->options, Arguments{"--error=" + NumberText(error)});
    SetConstant(q, error);
  } else if (kind == "relative") {
    const double percent = 100 * step.Number("error", 0.01);
    const double part = percent / 100;
    q->json["threshold"] = {{"relative", part}};
    AddOptions(&q->options, Arguments{"--error=" + NumberText(percent) + "%"});
    SetConstant(q, part * diagonal);
  } else if (kind == "coarsest") {
    q->json["threshold"] = "coarsest";
    AddOptions(&q->options, std::nullopt);
    SetConstant(q, kInfinity);
    q->query.threshold = CoarsestThreshold();
  } else if (kind == "linear") {
    const Vec3d c = FocusOf(step, truth);
    const double slope = step.Number("slope", 0.05);
    q->json["threshold"] = {{"linear", {{"point", Point(c)}, {"base", error}, {"slope", slope}}}};
    AddOptions(&q->options, Arguments{"--error-at=linear," + List({c.x, c.y, c.z, error, slope})});
    q->query.threshold = LinearThreshold(c, error, slope);
    q->permitted = [=](Vec3d p) { return std::max(0.0, error + slope * Length(p - c)); };
    q->partly_full = slope < 0;
  } else if (kind == "quadratic" || kind == "sqrt" || kind == "exp") {
    SetCurve(step, truth, kind, error, q);
  } else if (kind == "screen") {
    const Vec3d c = FocusOf(step, truth);
    const Camera camera = CameraAt(c, 0.4 * truth.diagonal());
    const double pixels = std::max(1e-6, 800 * step.Number("error", 0.01));
    q->json["threshold"] = {{"screen", {{"camera", CameraJson(camera)}, {"pixels", pixels}}}};
    AddOptions(&q->options, std::nullopt);
    q->query.threshold = ScreenThreshold(camera, pixels);
    // Where the eye is all the picture is one point; there and behind it any error is permitted.
    const double corner = std::hypot(camera.tangent_x(), camera.tangent_y());
    q->permitted = [=, axes = camera.axes()](Vec3d p) {
      const double z = Dot(p - camera.eye, axes.forward);
      if (z < 0) return kInfinity;
      const double aside = std::sqrt(SquaredLength(p - camera.eye - axes.forward * z));
      const double r = std::hypot(z, std::min(aside, corner * z));
      return r > 0 ? pixels * camera.pixel() * z * z / r : 0.0;
    };
  } else if (kind == "grid") {
    SetGrid(truth, error, error2, q);
  } else if (kind == "smallest" || kind == "largest") {
    const Vec3d c = FocusOf(step, truth);
    const double slope = std::abs(step.Number("slope", 0.05));
    const bool smallest = kind == "smallest";
    q->json["threshold"] = {
        {kind, Json::array({{{"linear", {{"point", Point(c)}, {"base", error}, {"slope", slope}}}},
                            error2})}};
    const std::vector<ThresholdPtr> both{LinearThreshold(c, error, slope),
                                         ConstantThreshold(error2)};
    q->query.threshold = smallest ? MinThreshold(both) : MaxThreshold(both);
    q->permitted = [=](Vec3d p) {
      const double linear = error + slope * Length(p - c);
      return smallest ? std::min(linear, error2) : std::max(linear, error2);
    };
    AddOptions(&q->options, smallest
                                ? std::optional(Arguments{
                                      "--error=" + NumberText(error2),
                                      "--error-at=linear," + List({c.x, c.y, c.z, error, slope})})
                                : std::nullopt);
  } else if (kind == "inside" && region) {
    q->json["threshold"] = {
        {"by_region", {{"region", region->json}, {"inside", error}, {"outside", error2}}}};
    AddOptions(&q->options, region->option);
    AddOptions(&q->options,
               Arguments{"--error=" + NumberText(error), "--error-outside=" + NumberText(error2)});
    q->query.threshold =
        RegionThreshold(region->region, ConstantThreshold(error), ConstantThreshold(error2));
    // On the border, which rounding may put on either side, the larger one will do.
    const double border = 1e-9 * (truth.diagonal() + Length(truth.bounds.max));
    q->permitted = [=, depth = region->depth](Vec3d p) {
      const double d = depth(p);
      return d > border ? error : d < -border ? error2 : std::max(error, error2);
    };
  } else {
    if (step.has("threshold")) {
      q->json["threshold"] = "full";
      // The command line takes a budget for the opposite.
      const bool budget = step.has("triangles") || step.has("bytes") || step.has("ms");
      AddOptions(&q->options, budget ? Arguments{} : Arguments{"--full"});
    }
    q->query.threshold = FullResolution();
    q->full = true;
    q->permitted_everywhere = 0;
    q->permitted = [](Vec3d) { return 0.0; };
  }
}

}  // namespace

Question MakeQuestion(const Step& step, const Truth& truth, double diagonal) {
  Question q;
  q.json = Json::object();
  q.options = Arguments{};
  std::optional<RegionText> region;
  if (step.has("region")) region = Combined(step, truth);
  SetThreshold(step, truth, diagonal, region, &q);
  q.depth = [](Vec3d) { return kInfinity; };
  if (region && step.Text("threshold") != "inside") {
    q.everywhere = false;
    q.depth = region->depth;
    q.json["region"] = region->json;
    AddOptions(&q.options, region->option);
    q.query.region = region->region;
  }
  if (step.has("triangles")) {
    const double part = std::clamp(step.Number("triangles", 0.5), 0.0, 2.0);
    q.max_triangles =
        static_cast<uint64_t>(1 + part * static_cast<double>(truth.mesh.triangles.size()));
    q.json["max_triangles"] = *q.max_triangles;
    AddOptions(&q.options, Arguments{"--triangles", std::to_string(*q.max_triangles)});
    q.query.max_triangles = q.max_triangles;
  }
  if (step.has("bytes")) {
    const auto bytes = static_cast<uint64_t>(std::max<int64_t>(1, step.Int("bytes", 1)));
    q.has_bytes = true;
    q.json["max_bytes"] = bytes;
    AddOptions(&q.options, Arguments{"--max-bytes", std::to_string(bytes)});
    q.query.max_bytes = bytes;
  }
  if (step.has("ms")) {
    const double ms = std::max(0.0, step.Number("ms", 0));
    q.has_time = true;
    q.json["max_milliseconds"] = ms;
    AddOptions(&q.options, Arguments{"--max-milliseconds", NumberText(ms)});
    q.query.max_milliseconds = ms;
  }
  q.clip = step.Flag("clip") && !q.everywhere;
  if (q.clip) {
    q.json["clip"] = true;
    AddOptions(&q.options, Arguments{"--clip"});
    q.query.clip = true;
  }
  const auto& attributes = truth.mesh.header.attributes.attributes;
  q.normals = step.Flag("normals") && std::ranges::none_of(attributes, [](const auto& a) {
                return a.name == "nx" || a.name == "normal_x";
              });
  if (q.normals) {
    q.json["normals"] = true;
    AddOptions(&q.options, Arguments{"--normals"});
    q.query.normals = true;
  }
  q.implicit = step.Flag("implicit");
  return q;
}

Step MovedBack(const Step& step, int64_t moves) {
  constexpr double kWay[] = {1, -0.5, 0.25};
  Step moved = step;
  const double by = static_cast<double>(moves) * step.Number("moves-by", 0.01);
  for (const char* key : {"at", "at2", "focus"}) {
    std::vector<double> where = Numbers(step.Text(key));
    where.resize(3, 0.5);
    std::string text;
    for (size_t i = 0; i < 3; ++i) {
      text += (i == 0 ? "" : ",") + NumberText(where[i] + by * kWay[i]);
    }
    moved.Set(key, text);
  }
  if (step.Flag("grows")) moved.Set("r", step.Number("r", 0.2) * (1 + by));
  return moved;
}

std::vector<std::string> RegionNames() {
  std::vector<std::string> names;
  for (const RegionKind& k : kRegions) names.emplace_back(k.name);
  return names;
}

std::vector<std::string> ThresholdNames() {
  return {"full",      "constant", "relative", "coarsest", "linear",   "inside", "screen",
          "quadratic", "sqrt",     "exp",      "grid",     "smallest", "largest"};
}

}  // namespace mtdb::everything
