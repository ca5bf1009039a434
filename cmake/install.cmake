# SPDX-License-Identifier: Apache-2.0
# What `cmake --install` puts where. Components: query (headers and libraries of base, store, codecs
# and query), builder, raster, client, show (pictures and the server), c (its headers, and what programs link by), runtime (libmtdb.so.0),
# tools (the program, its manual and completion) and python; without --component, all of them.
include(CMakePackageConfigHelpers)
set(MTDB_INSTALL_CMAKE ${CMAKE_INSTALL_LIBDIR}/cmake/mtdb)

# What a user needs, and nothing else: installed_headers.txt has a component and a header a line.
# Headers keep their folders: "query/surface.h" is found below include/mtdb.
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS cmake/installed_headers.txt)
file(STRINGS ${PROJECT_SOURCE_DIR}/cmake/installed_headers.txt mtdb_installed_headers)
foreach(line ${mtdb_installed_headers})
  separate_arguments(line)
  list(GET line 0 component)
  list(GET line 1 header)
  cmake_path(GET header PARENT_PATH folder)
  install(FILES ${header} DESTINATION ${MTDB_INSTALL_HEADERS}/${folder} COMPONENT ${component})
endforeach()

# mtdbTargets-<component>.cmake, which mtdbConfig.cmake includes where it is installed.
function(mtdb_install_targets component)
  install(TARGETS ${ARGN} EXPORT mtdbTargets-${component}
    ARCHIVE COMPONENT ${component} LIBRARY COMPONENT runtime NAMELINK_COMPONENT ${component})
  install(EXPORT mtdbTargets-${component} NAMESPACE mtdb:: DESTINATION ${MTDB_INSTALL_CMAKE}
    COMPONENT ${component})
endfunction()

foreach(folder store query builder)
  get_property(mtdb_rooms_of_${folder} GLOBAL PROPERTY mtdb_rooms_of_${folder})
endforeach()
mtdb_install_targets(query mtdb_base ${mtdb_rooms_of_store} mtdb_store mtdb_coding mtdb_cluster
  mtdb_stream mtdb_mesh_file mtdb_codecs ${mtdb_rooms_of_query} mtdb_query)
mtdb_install_targets(builder mtdb_image_file ${mtdb_rooms_of_builder} mtdb_builder)
mtdb_install_targets(raster mtdb_raster_file mtdb_gdal)
mtdb_install_targets(client mtdb_client)
mtdb_install_targets(show mtdb_request mtdb_viewer mtdb_tiles mtdb_server mtdb_generate mtdb_render)
mtdb_install_targets(c mtdb_c)
install(TARGETS mtdb RUNTIME COMPONENT tools)
if(GDAL_FOUND)
  install(TARGETS mtdb_gdal_module LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/mtdb COMPONENT tools)
endif()
install(DIRECTORY ${PROJECT_BINARY_DIR}/manual/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1
  COMPONENT tools FILES_MATCHING PATTERN "*.1")
install(FILES ${PROJECT_BINARY_DIR}/manual/mtdb.bash RENAME mtdb
  DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions COMPONENT tools)
install(DIRECTORY tools/python/mtdb DESTINATION lib/python3/dist-packages COMPONENT python
  FILES_MATCHING PATTERN "*.py" PATTERN "py.typed" PATTERN "__pycache__" EXCLUDE)

# For those who do not use CMake: pkg-config mtdb is libmtdb.so. The C++ libraries are static, and
# have the CMake package.
file(RELATIVE_PATH MTDB_PC_PREFIX /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
configure_file(cmake/mtdb.pc.in ${PROJECT_BINARY_DIR}/mtdb.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/mtdb.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig
  COMPONENT c)

configure_package_config_file(cmake/mtdbConfig.cmake.in ${PROJECT_BINARY_DIR}/mtdbConfig.cmake
  INSTALL_DESTINATION ${MTDB_INSTALL_CMAKE})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/mtdbConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
foreach(component query c)
  install(FILES ${PROJECT_BINARY_DIR}/mtdbConfig.cmake
    ${PROJECT_BINARY_DIR}/mtdbConfigVersion.cmake cmake/FindLMDB.cmake cmake/FindxxHash.cmake
    DESTINATION ${MTDB_INSTALL_CMAKE} COMPONENT ${component})
endforeach()
