// SPDX-License-Identifier: Apache-2.0
// What an answer must be.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "tests/everything/output_files.h"
#include "tests/everything/world.h"

namespace mtdb::everything {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr uint64_t kSamples = 400;
constexpr size_t kMaxPoints = 4000;

class Judgement {
 public:
  Judgement(const Asked& asked, const Answer& answer, const Answer* reference,
            const std::set<std::string>& told)
      : asked_(asked),
        told_(told),
        object_(*asked.object),
        question_(*asked.question),
        answer_(answer),
        reference_(reference),
        row_bytes_(object_.layout.row_bytes()) {
    double largest = 0;
    for (int i = 0; i < 3; ++i) {
      largest = std::max(
          {largest, std::abs(object_.truth.bounds.min[i]), std::abs(object_.truth.bounds.max[i])});
    }
    // A .ply is so where float32 is enough for the grid.
    lossy_ = answer.lossy || (answer.format == "ply" && !answer.mesh.header.double_positions &&
                              !object_.grid.FitsFloat(object_.truth.bounds));
    exactness_ = 1e-13 * (largest + object_.truth.diagonal());
    border_ = object_.displaced + 1e-6 * (largest + object_.truth.diagonal()) * 0.2;
  }

  std::set<std::string> Run() {
    if (answer_.triangles != answer_.mesh.triangles.size() && !lossy_) {
      Fault("tells another number of triangles", std::to_string(answer_.triangles) + ", sent " +
                                                     std::to_string(answer_.mesh.triangles.size()));
    }
    Limits();
    if (answer_.exact) {
      Vertices();
      Topology();
      Resolution();
    }
    if (reference_ != nullptr) Same();
    if (question_.normals && answer_.exact) Normals();
    if (lossy_ && !answer_.mesh.header.attributes.empty()) CarriedAttributes();
    if (!is_the_same_) Distances();
    return found_;
  }

 private:
  // What the first way gets wrong, all do.
  void Fault(const std::string& what, const std::string& detail) {
    found_.insert(what);
    if (told_.contains(what)) return;
    const std::string where = answer_.format.empty() ? answer_.way : "file " + answer_.format;
    asked_.world->Fault("answer: " + where + ": " + what,
                        detail + "; " + answer_.way + ": " + asked_.name + " " + question_.text());
  }
  bool accurate() const { return answer_.limit == "accuracy"; }

  void Limits() {
    if (question_.max_triangles && !question_.clip && answer_.limit != "" &&
        answer_.triangles > std::max(*question_.max_triangles, object_.root_triangles)) {
      Fault("more triangles than asked for", std::to_string(answer_.triangles));
    }
    if (!question_.max_triangles && !question_.has_bytes && !question_.has_time &&
        answer_.limit != "accuracy") {
      Fault("a limit that nobody set", answer_.limit);
    }
    if (!std::isfinite(answer_.bound) || answer_.bound < 0) {
      Fault("no error bound", NumberText(answer_.bound));
    }
    const double asked = question_.permitted_everywhere;
    // Where nothing reaches the region, the bound is what rounding moved, and nothing falls short.
    if ((reference_ == nullptr ? answer_ : *reference_).active == 0) return;
    if (accurate() && asked > 0 && answer_.bound > (asked + answer_.excess) * (1 + 1e-5)) {
      Fault("bound above the requested error",
            NumberText(answer_.bound) + ", requested " + NumberText(asked));
    }
    if (accurate() && asked > 0 && answer_.excess > 0 && answer_.bound <= asked * (1 - 1e-5)) {
      Fault("a shortfall without one", NumberText(answer_.excess));
    }
  }

  void Vertices() {
    std::vector<bool> used(answer_.mesh.positions.size(), false);
    for (const TriangleVertices& t : answer_.mesh.triangles) {
      for (const VertexIndex v : t) used[v] = true;
    }
    for (size_t v = 0; v < used.size(); ++v) {
      if (!used[v] && !answer_.mesh.triangles.empty())
        return Fault("a vertex without a triangle", std::to_string(v));
      if (!object_.vertices.contains(VertexKey(answer_.mesh, v, false, row_bytes_))) {
        return Fault("a vertex that is none of the input's", std::to_string(v));
      }
    }
  }

  void Topology() {
    if (question_.clip) return;
    const auto found = mtdb::testing::CheckMesh(answer_.mesh);
    const auto& truth = object_.truth.topology;
    const auto same = [&](uint64_t a, uint64_t b, const char* what) {
      if (a != b) Fault(what, std::to_string(a) + ", the input has " + std::to_string(b));
    };
    same(found.bad_indices + found.degenerate_triangles + found.unused_vertices, 0,
         "broken triangles");
    // Small parts vanish, and chains of such edges become shorter.
    const auto shorter = [&](uint64_t a, uint64_t b, const char* what) {
      if (a > b) same(a, b, what);
    };
    shorter(found.components, truth.components, "components");
    shorter(found.nonmanifold_edges, truth.nonmanifold_edges, "non-manifold edges");
    shorter(found.misoriented_edges, truth.misoriented_edges, "edges of two orientations");
    shorter(found.nonmanifold_vertices, truth.nonmanifold_vertices, "non-manifold vertices");
    if (truth.ok()) {
      same(found.duplicate_triangles, 0, "duplicate triangles");
      if (found.components < truth.components) return;
      same(static_cast<uint64_t>(found.euler_characteristic),
           static_cast<uint64_t>(truth.euler_characteristic), "Euler characteristic");
      same(found.boundary_loops, truth.boundary_loops, "border loops");
    }
  }

  // Full resolution where it was asked for.
  void Resolution() {
    if (!question_.full || answer_.limit != "accuracy") return;
    const auto found = TriangleKeys(answer_.mesh, false, row_bytes_);
    if (question_.everywhere) {
      if (found != TriangleKeys(object_.mesh, false, row_bytes_)) {
        Fault("full resolution is not the input",
              std::to_string(found.size()) + " triangles of " +
                  std::to_string(object_.mesh.triangles.size()));
      }
      return;
    }
    TriangleMesh inside = object_.mesh;
    std::erase_if(inside.triangles, [&](const TriangleVertices& t) {
      return std::ranges::none_of(
          t, [&](VertexIndex v) { return question_.depth(object_.mesh.positions[v]) > border_; });
    });
    const auto wanted = TriangleKeys(inside, false, row_bytes_);
    if (!std::ranges::includes(found, wanted)) {
      Fault("the region is not at full resolution", std::to_string(wanted.size()) + " wanted");
    }
  }

  // All ways of asking give the same.
  void Same() {
    // What is in the cache costs nothing, and nobody is equally fast twice, so answers differ.
    if (question_.has_bytes ||
        (question_.has_time && answer_.limit + reference_->limit != "accuracyaccuracy")) {
      return;
    }
    if (!lossy_) {
      const size_t row = answer_.has_rows ? row_bytes_ : 0;
      const auto mine = TriangleKeys(answer_.mesh, true, row);
      const auto theirs = TriangleKeys(reference_->mesh, true, row);
      // Then the first one's distances are its own.
      is_the_same_ = answer_.exact && mine == theirs && answer_.bound >= reference_->bound;
      if (mine != theirs) {
        Fault("another mesh", std::to_string(mine.size()) + " triangles, " + reference_->way +
                                  " has " + std::to_string(theirs.size()));
      }
    } else if (!question_.max_triangles && !question_.clip &&
               answer_.triangles < reference_->mesh.triangles.size()) {
      // What such a format rounds is taken from the threshold and added to the region.
      Fault("fewer triangles", std::to_string(answer_.triangles));
    }
    if (answer_.limit != reference_->limit) {
      Fault("another limit", answer_.limit + ", not " + reference_->limit);
    }
    // With a little less error permitted, more triangles may be split, the largest errors too.
    const bool finer = lossy_ && answer_.triangles != reference_->mesh.triangles.size();
    if (!answer_.any_bound && !finer && answer_.bound < reference_->bound * (1 - 1e-5)) {
      Fault("another error bound",
            NumberText(answer_.bound) + ", not " + NumberText(reference_->bound));
    }
  }

  void Normals() {
    const AttributeLayout& layout = answer_.mesh.header.attributes;
    const size_t stride = layout.row_bytes();
    if (stride != row_bytes_ + 12) return Fault("no normals", std::to_string(stride));
    if (question_.clip) return;  // the triangles that are cut off count too
    const TriangleMesh& mesh = answer_.mesh;
    std::vector<Vec3d> sums(mesh.positions.size());
    std::vector<double> sizes(mesh.positions.size(), 0);
    for (const TriangleVertices& t : mesh.triangles) {
      const Vec3d n = Cross(mesh.positions[t[1]] - mesh.positions[t[0]],
                            mesh.positions[t[2]] - mesh.positions[t[0]]);
      for (const VertexIndex v : t) sums[v] += n;
      for (const VertexIndex v : t) sizes[v] += Length(n);
    }
    for (size_t v = 0; v < sums.size(); ++v) {
      if (!(Length(sums[v]) > 1e-3 * sizes[v]) || !(sizes[v] > 0)) continue;
      float n[3];
      std::memcpy(n, mesh.rows.data() + v * stride + row_bytes_, sizeof(n));
      const Vec3d told{n[0], n[1], n[2]};
      if (Length(told - sums[v] * (1 / Length(sums[v]))) > 1e-3) {
        return Fault("a wrong normal", std::to_string(v));
      }
    }
  }

  // The attributes that such a format carries are those of a vertex that is where its positions
  // have moved from.
  void CarriedAttributes() {
    std::vector<VertexIndex> by_x;
    for (const TriangleVertices& t : object_.mesh.triangles) {
      by_x.insert(by_x.end(), t.begin(), t.end());
    }
    const auto x_of = [&](VertexIndex v) { return object_.mesh.positions[v].x; };
    std::ranges::sort(by_x, [&](VertexIndex a, VertexIndex b) {
      return std::pair(x_of(a), a) < std::pair(x_of(b), b);
    });
    by_x.erase(std::unique(by_x.begin(), by_x.end()), by_x.end());
    const double near = 4 * Rounded() + exactness_;
    const size_t stride = answer_.mesh.positions.size() / kMaxPoints + 1;
    for (size_t v = 0; v < answer_.mesh.positions.size(); v += stride) {
      const Vec3d p = answer_.mesh.positions[v];
      const auto* row = answer_.mesh.rows.data() + v * answer_.mesh.header.attributes.row_bytes();
      bool found = false;
      auto at = std::ranges::lower_bound(by_x, p.x - near, {}, x_of);
      for (; !found && at != by_x.end() && x_of(*at) <= p.x + near; ++at) {
        if (Length(object_.mesh.positions[*at] - p) > near) continue;
        found = CarriedRowMatches(answer_.format, answer_.mesh.header.attributes, row,
                                  object_.layout, object_.mesh.rows.data() + *at * row_bytes_);
      }
      if (!found) return Fault("attributes of no vertex there", std::to_string(v));
    }
  }

  // Points of one side, the distance of which to the other is looked at.
  void Side(const char* what, const TriangleMesh& from, const DistanceTree& to,
            double depth_needed) {
    std::vector<Vec3d> points = SamplePoints(from, kSamples, 1);
    const size_t stride = points.size() / kMaxPoints + 1;
    double worst = 0, worst_excess = 0;
    for (size_t i = 0; i < points.size(); i += stride) {
      const Vec3d p = points[i];
      if (!(question_.depth(p) > depth_needed)) continue;
      const double distance = to.Distance(p);
      worst = std::max(worst, distance);
      if (accurate() && !question_.full) {
        double permitted = question_.permitted(p);
        // Where less is asked for than can be had, full resolution is right, rounded as it is.
        if (question_.partly_full) permitted = std::max(permitted, object_.displaced + rounded_);
        worst_excess = std::max(worst_excess, distance - (permitted + answer_.excess) * (1 + 1e-5));
      }
    }
    if (worst > answer_.bound * (1 + 1e-5) + exactness_) {
      Fault(std::string(what) + " farther off than the bound",
            NumberText(worst) + ", bound " + NumberText(answer_.bound));
    }
    if (worst_excess > exactness_) {
      Fault(std::string(what) + " farther off than requested",
            "by " + NumberText(worst_excess) + ", bound " + NumberText(answer_.bound));
    }
  }

  // How far the format has moved vertices.
  double Rounded() const {
    TriangleMesh points = object_.mesh;
    points.triangles.clear();
    for (const TriangleVertices& t : object_.mesh.triangles) {
      for (const VertexIndex v : t) points.triangles.push_back({v, v, v});
    }
    const DistanceTree tree(points);
    double most = 0;
    for (const Vec3d p : answer_.mesh.positions) most = std::max(most, tree.Distance(p));
    return most;
  }

  void Distances() {
    if (answer_.mesh.triangles.empty()) return;
    const DistanceTree tree(answer_.mesh);
    if (question_.partly_full && lossy_) rounded_ = Rounded();
    // All of a clipped answer meets the region.
    Side("the answer is", answer_.mesh, *object_.truth.tree, question_.clip ? -kInfinity : border_);
    Side("the input is", object_.truth.original(), tree,
         border_ + (question_.clip ? 2 * answer_.bound : 0));
  }

  const Asked& asked_;
  const std::set<std::string>& told_;
  std::set<std::string> found_;
  const StoredObject& object_;
  const Question& question_;
  const Answer& answer_;
  const Answer* reference_;
  const size_t row_bytes_;
  bool lossy_ = false;
  double exactness_ = 0;
  double border_ = 0;
  double rounded_ = 0;
  bool is_the_same_ = false;  // as the first answer
};

}  // namespace

std::set<std::string> Judge(const Asked& asked, const Answer& answer, const Answer* reference,
                            const std::set<std::string>& told) {
  return Judgement(asked, answer, reference, told).Run();
}

}  // namespace mtdb::everything
