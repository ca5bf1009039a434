# SPDX-License-Identifier: Apache-2.0
# mtdb_hausdorff: measured distances by CGAL's AABB tree, for tests and benchmarks.
include_guard(GLOBAL)
find_package(CGAL REQUIRED)
add_library(mtdb_hausdorff STATIC ${CMAKE_CURRENT_LIST_DIR}/hausdorff.cc)
target_link_libraries(mtdb_hausdorff PUBLIC mtdb_base PRIVATE CGAL::CGAL Threads::Threads)
target_compile_definitions(mtdb_hausdorff PRIVATE CGAL_NDEBUG)
