// SPDX-License-Identifier: Apache-2.0
// Probes: the closest point of a surface, and the first hit of a ray, beside brute force.
//
// Parameters of a step, all optional:
//   ray    1: casts a ray; without, looks for the closest point
//   at     from where, from 0,0,0 to 1,1,1 of the object's box; to: where a ray goes
//   error  of the diagonal; without, full resolution
//   limit  of the diagonal, for rays of their direction; without, none
#include "query/probe.h"

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "store/database.h"
#include "tests/everything/world.h"

namespace mtdb::everything {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Vec3d PlaceIn(const Box3d& box, const std::string& at, double otherwise) {
  std::vector<double> where = Numbers(at);
  where.resize(3, otherwise);
  const Vec3d size = box.max - box.min;
  Vec3d p;
  for (int i = 0; i < 3; ++i) p[i] = box.min[i] + size[i] * where[static_cast<size_t>(i)];
  return p;
}

// Where a ray meets a triangle: surely, or not surely not.
struct Meeting {
  double t = kInfinity;
  bool sure = false;
};

Meeting Meet(Vec3d origin, Vec3d direction, const Triangle3d& triangle) {
  using Real = long double;
  Real a[3][3], d[3];
  for (size_t c = 0; c < 3; ++c) {
    for (int i = 0; i < 3; ++i) a[c][i] = static_cast<Real>(triangle[c][i]) - origin[i];
  }
  for (int i = 0; i < 3; ++i) d[i] = direction[i];
  const auto volume = [&](const Real* u, const Real* v) {
    return d[0] * (u[1] * v[2] - u[2] * v[1]) + d[1] * (u[2] * v[0] - u[0] * v[2]) +
           d[2] * (u[0] * v[1] - u[1] * v[0]);
  };
  const auto length = [](const Real* u) {
    return std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
  };
  Real w[3], sum = 0, size = 0;
  bool all_in = true, all_out = true, maybe_in = true, maybe_out = true;
  for (size_t e = 0; e < 3; ++e) {
    const Real* const u = a[(e + 1) % 3];
    const Real* const v = a[(e + 2) % 3];
    w[e] = volume(u, v);
    const Real noise = 1e-11L * length(d) * length(u) * length(v);
    all_in &= w[e] > noise;
    all_out &= w[e] < -noise;
    maybe_in &= w[e] > -noise;
    maybe_out &= w[e] < noise;
    sum += w[e];
    size += noise;
  }
  if ((!maybe_in && !maybe_out) || std::abs(sum) <= size) return {};
  Real t = 0;
  for (size_t c = 0; c < 3; ++c) {
    const Real along = a[c][0] * d[0] + a[c][1] * d[1] + a[c][2] * d[2];
    t += w[c] / sum * along;
  }
  t /= length(d) * length(d);
  return {static_cast<double>(t), all_in || all_out};
}

class Probing {
 public:
  Probing(World& world, const Step& step, std::string name, const StoredObject& object)
      : world_(world), name_(std::move(name)), object_(object), ray_(step.Flag("ray")) {
    const Box3d& box = object.truth.bounds;
    origin_ = PlaceIn(box, step.Text("at", "0.5,0.5,2"), 0.5);
    direction_ = PlaceIn(box, step.Text("to", "0.5,0.5,0.5"), 0.5) - origin_;
    if (!(Length(direction_) > 0)) direction_ = {0, 0, -1};
    if (step.has("error")) error_ = step.Number("error", 0.01) * object.truth.diagonal();
    if (step.has("limit")) {
      limit_ = step.Number("limit", 1) * (ray_ ? 1 : object.truth.diagonal());
    }
    double largest = Length(origin_);
    for (int i = 0; i < 3; ++i) {
      largest = std::max({largest, std::abs(box.min[i]), std::abs(box.max[i])});
    }
    exactness_ = 1e-12 * (largest + object.truth.diagonal());
  }

  void Run(int64_t store) {
    ++world_.counts().answers;
    const auto answer = InProcess(store);
    if (!answer.ok()) {
      return world_.ErrorFault("probe: refused", answer.status().message());
    }
    Judge(*answer);
    ++world_.counts().answers;
    Command(store, *answer);
  }

 private:
  void Fault(const std::string& what, const std::string& detail) {
    world_.Fault(std::string(ray_ ? "ray: " : "closest point: ") + what, detail + "; " + name_);
  }

  Result<ProbeAnswer> InProcess(int64_t store) {
    MTDB_ASSIGN_OR_RETURN(const auto database, Database::Open(world_.Store(store).path));
    MTDB_ASSIGN_OR_RETURN(auto source, database->OpenObject(name_));
    MTDB_ASSIGN_OR_RETURN(const auto surface, Surface::Open(std::move(source), {.threads = 1}));
    const ProbeOptions options{error_, limit_, nullptr};
    return ray_ ? CastRay(*surface, origin_, direction_, options)
                : FindClosestPoint(*surface, origin_, options);
  }

  void Judge(const ProbeAnswer& answer) {
    const bool full = error_ < 0;
    if (answer.hit) {
      const double bound = answer.error_bound * (1 + 1e-5) + exactness_;
      if (!full && answer.error_bound > (error_ + answer.excess) * (1 + 1e-5)) {
        Fault("bound above the requested error", NumberText(answer.error_bound));
      }
      const double far = ray_ ? answer.hit->parameter : answer.hit->distance;
      if (far > limit_) Fault("beyond the limit", NumberText(far));
      const double off = object_.truth.tree->Distance(answer.hit->point);
      if (off > bound) {
        Fault("a point farther from the input than the bound",
              NumberText(off) + ", bound " + NumberText(answer.error_bound));
      }
    }
    ray_ ? JudgeRay(answer, full) : JudgePoint(answer, full);
  }

  void JudgePoint(const ProbeAnswer& answer, bool full) {
    const double truth =
        full ? DistanceTree(object_.mesh).Distance(origin_) : object_.truth.tree->Distance(origin_);
    if (!answer.hit) {
      const double off = full ? 0 : std::max(error_, object_.displaced);
      if (truth + off * (1 + 1e-5) + exactness_ < limit_) Fault("nothing found", NumberText(truth));
      return;
    }
    const double permitted = (full ? 0 : answer.error_bound * (1 + 1e-5)) + exactness_;
    if (std::abs(answer.hit->distance - truth) > permitted) {
      Fault("a wrong distance",
            NumberText(answer.hit->distance) + ", by brute force " + NumberText(truth));
    }
    if (std::abs(Length(answer.hit->point - origin_) - answer.hit->distance) > exactness_) {
      Fault("a distance that is not its point's", NumberText(answer.hit->distance));
    }
  }

  // Of the input's own triangles; at other accuracies only the hit's place says something.
  void JudgeRay(const ProbeAnswer& answer, bool full) {
    if (!full) return;
    double first = kInfinity;  // that is sure
    for (const TriangleVertices& t : object_.mesh.triangles) {
      const Meeting m = Meet(origin_, direction_,
                             {object_.mesh.positions[t[0]], object_.mesh.positions[t[1]],
                              object_.mesh.positions[t[2]]});
      const double edge = exactness_ / Length(direction_);
      if (m.sure && m.t > edge && m.t < first && m.t < limit_ - edge) first = m.t;
    }
    const double found = answer.hit ? answer.hit->parameter : kInfinity;
    if (found > first + 1e-6 + exactness_ / Length(direction_)) {
      Fault("a hit is passed", NumberText(found) + ", by brute force " + NumberText(first));
    }
    if (!answer.hit) return;
    const Vec3d along = origin_ + direction_ * answer.hit->parameter;
    if (Length(along - answer.hit->point) > exactness_ * 100) {
      Fault("a point beside the ray", NumberText(Length(along - answer.hit->point)));
    }
    const double off = DistanceTree(object_.mesh).Distance(answer.hit->point);
    if (off > exactness_ * 100) Fault("a point beside the surface", NumberText(off));
  }

  void Command(int64_t store, const ProbeAnswer& answer) {
    const auto list = [](Vec3d p) {
      return NumberText(p.x) + "," + NumberText(p.y) + "," + NumberText(p.z);
    };
    Arguments arguments{"probe", world_.Store(store).path, "--name", name_, "--json"};
    arguments.push_back(ray_ ? "--ray=" + list(origin_) + "," + list(direction_)
                             : "--point=" + list(origin_));
    if (error_ >= 0) arguments.push_back("--error=" + NumberText(error_));
    if (limit_ < kInfinity) arguments.push_back("--limit=" + NumberText(limit_));
    const Ran ran = world_.Mtdb(arguments);
    const auto json = nlohmann::json::parse(ran.out, nullptr, false);
    if (!ran.ok() || !json.is_object()) return world_.ErrorFault("probe: command", ran.err);
    const bool hit = json.value("hit", false);
    const bool same = hit == answer.hit.has_value() &&
                      (!hit || (json.value("distance", -1.0) == answer.hit->distance &&
                                json.value("parameter", 0.0) == answer.hit->parameter &&
                                json.value("error_bound", -1.0) == answer.error_bound));
    if (!same) Fault("the command says something else", ran.out);
  }

  World& world_;
  const std::string name_;
  const StoredObject& object_;
  const bool ray_;
  Vec3d origin_, direction_;
  double error_ = -1;
  double limit_ = kInfinity;
  double exactness_ = 0;
};

}  // namespace

void JudgeProbe(World& world, const Step& step, int64_t store, const std::string& name,
                const StoredObject& object) {
  Probing(world, step, name, object).Run(store);
}

}  // namespace mtdb::everything
