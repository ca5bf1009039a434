# SPDX-License-Identifier: Apache-2.0
# Debian packages: `cpack` in the build folder, or tools/debian.
#   mtdb          the program, its manual and completion
#   libmtdb0      libmtdb.so.0
#   libmtdb-dev   headers, static libraries, the CMake package, pkg-config
#   python3-mtdb  the Python package, over libmtdb0
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME mtdb)
set(CPACK_PACKAGE_VENDOR mtdb)
set(CPACK_PACKAGE_CONTACT "the makers of mtdb <mtdb@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "out-of-core database of triangle meshes")
set(CPACK_PACKAGE_DESCRIPTION "mtdb stores triangle meshes of any size at every level of detail, and gives any region at any
accuracy as the smallest conforming mesh that keeps the error bound.")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_COMPONENTS_ALL tools runtime query builder raster client show c python)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)

set(CPACK_DEBIAN_TOOLS_PACKAGE_NAME mtdb)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME libmtdb${PROJECT_VERSION_MAJOR})
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_DEV_PACKAGE_NAME libmtdb-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "libmtdb${PROJECT_VERSION_MAJOR} (= ${PROJECT_VERSION}), liblmdb-dev, \
libzstd-dev, libxxhash-dev, zlib1g-dev, libdraco-dev, libmeshoptimizer-dev, libcurl4-openssl-dev, libembree-dev, libpng-dev, libjpeg-dev")
set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-mtdb)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
  "libmtdb${PROJECT_VERSION_MAJOR} (= ${PROJECT_VERSION}), python3 (>= 3.9), python3-numpy")
set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS "python3-tqdm, python3-open3d")
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA
  ${PROJECT_SOURCE_DIR}/cmake/python_package/postinst ${PROJECT_SOURCE_DIR}/cmake/python_package/prerm)

foreach(pair tools:mtdb runtime:libmtdb${PROJECT_VERSION_MAJOR} c:libmtdb-dev python:python3-mtdb)
  string(REPLACE ":" ";" pair ${pair})
  list(GET pair 0 component)
  list(GET pair 1 package)
  install(FILES docs/licenses.md LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package}
    COMPONENT ${component})
  install(FILES cmake/copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package}
    COMPONENT ${component})
endforeach()

include(CPack)
foreach(component query builder raster client show c)
  cpack_add_component(${component} GROUP dev)
endforeach()
foreach(component tools runtime python)
  cpack_add_component(${component} GROUP ${component})
endforeach()
