// SPDX-License-Identifier: Apache-2.0
// CheckCut: whether what meets in a complex meets in a cut of it, edge for edge. It judges the cut
// alone, and knows nothing of how it was made.
#pragma once

#include <string>
#include <vector>

#include "tests/sheets/complex.h"

namespace mtdb::sheets {

struct CutCheckOptions {
  // A patch of the complex of which the cut has no face may be missing: flaps, fins and components
  // that are smaller than the error. The rest is then held against what is left of the complex.
  bool patches_may_vanish = false;
};

struct CutReport {
  std::vector<std::string> complaints;  // the first twenty
  uint64_t vanished_patches = 0;
  uint64_t vanished_vertices = 0;  // of these patches alone
  bool ok() const { return complaints.empty(); }
  std::string Text() const;  // all complaints, one a line
};

// Each vertex of the cut is the vertex of the complex of the same position; positions of the
// complex must differ. Checks that
// - no face is there twice in one orientation, none is degenerate, and each has its corners in one
//   patch of the complex, which is two-sided where the face has an opposite and only there;
// - each chain of creases is there as a path through some of its vertices, all in their order, with
//   the same sheets in the same orientations at each edge, and its ends are kept;
// - all other edges have two sheets that go on in each other;
// - sheets that touch in a vertex only do so in the cut, and no others;
// - patches, components and the Euler characteristic are as many; closed patches that
//   are no flat or crumpled ones are not inside out.
CutReport CheckCut(const Complex& complex, const Complex& cut, const CutCheckOptions& options = {});

// The largest distance of a point of `from` from `to`: of the points of a lattice on each triangle
// whose steps are at most `step`, corners included. By CGAL.
double LargestDistance(const Complex& from, const Complex& to, double step);

}  // namespace mtdb::sheets
