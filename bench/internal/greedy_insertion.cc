// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/greedy_insertion.h"

#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <queue>

namespace mtdb {

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Faces = CGAL::Triangulation_face_base_with_info_2<uint64_t, Kernel>;  // when it was scanned
using Structure =
    CGAL::Triangulation_data_structure_2<CGAL::Triangulation_vertex_base_2<Kernel>, Faces>;
using Triangulation = CGAL::Delaunay_triangulation_2<Kernel, Structure>;
using Face = Triangulation::Face_handle;
using Point = Kernel::Point_2;

// The sample of a face that is farthest from it.
struct Candidate {
  double error;
  int64_t column, row;
  Face face;
  uint64_t scan;
  bool operator<(const Candidate& other) const { return error < other.error; }
};

class Insertion {
 public:
  explicit Insertion(const Heights& heights) : heights_(heights) {
    const int64_t right = heights.columns - 1;
    const int64_t top = heights.rows - 1;
    for (const auto& [x, y] :
         {std::pair<int64_t, int64_t>(0, 0), {right, 0}, {right, top}, {0, top}}) {
      mesh_.insert(Point(static_cast<double>(x), static_cast<double>(y)));
    }
    for (Face face : mesh_.finite_face_handles()) Scan(face);
  }

  uint64_t Run(double error) {
    std::vector<Face> gone;
    while (!heap_.empty() && heap_.top().error > error) {
      const Candidate c = heap_.top();
      heap_.pop();
      if (c.face->info() != c.scan) continue;
      const Point p(static_cast<double>(c.column), static_cast<double>(c.row));
      gone.clear();
      mesh_.get_conflicts(p, std::back_inserter(gone), c.face);
      for (Face face : gone) face->info() = 0;
      const auto vertex = mesh_.insert(p, c.face);
      auto face = mesh_.incident_faces(vertex);
      const auto first = face;
      do {
        if (!mesh_.is_infinite(face)) Scan(face);
      } while (++face != first);
    }
    return mesh_.number_of_faces();
  }

 private:
  void Scan(Face face) {
    face->info() = ++scans_;
    const Point a = face->vertex(0)->point();
    const Point b = face->vertex(1)->point();
    const Point c = face->vertex(2)->point();
    const double area = Turn(a, b, c);
    const auto [left, right] = std::minmax({a.x(), b.x(), c.x()});
    const auto [bottom, top] = std::minmax({a.y(), b.y(), c.y()});
    Candidate worst{0, 0, 0, face, scans_};
    for (auto row = static_cast<int64_t>(bottom); row <= static_cast<int64_t>(top); ++row) {
      for (auto column = static_cast<int64_t>(left); column <= static_cast<int64_t>(right);
           ++column) {
        const Point p(static_cast<double>(column), static_cast<double>(row));
        const double wa = Turn(b, c, p);
        const double wb = Turn(c, a, p);
        const double wc = Turn(a, b, p);
        if (wa < 0 || wb < 0 || wc < 0) continue;
        if (p == a || p == b || p == c) continue;  // and not off by a rounding
        const double height = (wa * At(a) + wb * At(b) + wc * At(c)) / area;
        const double error = std::abs(height - heights_.height(column, row));
        if (error > worst.error) worst = {error, column, row, face, scans_};
      }
    }
    if (worst.error > 0) heap_.push(worst);
  }
  static double Turn(const Point& a, const Point& b, const Point& c) {
    return (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
  }
  double At(const Point& p) const {
    return heights_.height(static_cast<int64_t>(p.x()), static_cast<int64_t>(p.y()));
  }

  const Heights& heights_;
  Triangulation mesh_;
  std::priority_queue<Candidate> heap_;
  uint64_t scans_ = 0;
};

}  // namespace

uint64_t TrianglesOfGreedyInsertion(const Heights& heights, double error) {
  return Insertion(heights).Run(error);
}

}  // namespace mtdb
