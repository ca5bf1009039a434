# What `cmake --install` puts where. Components: query (headers and libraries of base, store, codecs
# and query), builder, client, c (libmtdb.so) and tools (the program); without --component, all of
# them.
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
    ARCHIVE COMPONENT ${component} LIBRARY COMPONENT ${component} NAMELINK_COMPONENT ${component})
  install(EXPORT mtdbTargets-${component} NAMESPACE mtdb:: DESTINATION ${MTDB_INSTALL_CMAKE}
    COMPONENT ${component})
endfunction()

mtdb_install_targets(query mtdb_base mtdb_store mtdb_coding mtdb_cluster mtdb_stream
  mtdb_mesh_file mtdb_codecs mtdb_query)
mtdb_install_targets(builder mtdb_builder)
mtdb_install_targets(client mtdb_client)
mtdb_install_targets(c mtdb_c)
install(TARGETS mtdb RUNTIME COMPONENT tools)

configure_package_config_file(cmake/mtdbConfig.cmake.in ${PROJECT_BINARY_DIR}/mtdbConfig.cmake
  INSTALL_DESTINATION ${MTDB_INSTALL_CMAKE})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/mtdbConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
foreach(component query c)
  install(FILES ${PROJECT_BINARY_DIR}/mtdbConfig.cmake
    ${PROJECT_BINARY_DIR}/mtdbConfigVersion.cmake cmake/FindLMDB.cmake cmake/FindxxHash.cmake
    DESTINATION ${MTDB_INSTALL_CMAKE} COMPONENT ${component})
endforeach()
