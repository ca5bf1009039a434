# What `cmake --install` puts where. Components: query (headers and libraries of base, store, codecs
# and query), builder, client, c (libmtdb.so) and tools (the program); without --component, all of
# them.
include(CMakePackageConfigHelpers)
set(MTDB_INSTALL_CMAKE ${CMAKE_INSTALL_LIBDIR}/cmake/mtdb)

# Public headers keep their folders: "query/surface.h" is found below include/mtdb.
function(mtdb_install_headers component)
  install(DIRECTORY ${ARGN} DESTINATION ${MTDB_INSTALL_HEADERS} COMPONENT ${component}
    FILES_MATCHING PATTERN "*.h" PATTERN internal EXCLUDE PATTERN coding EXCLUDE
    PATTERN mtdb.h EXCLUDE)
endfunction()

# mtdbTargets-<component>.cmake, which mtdbConfig.cmake includes where it is installed.
function(mtdb_install_targets component)
  install(TARGETS ${ARGN} EXPORT mtdbTargets-${component}
    ARCHIVE COMPONENT ${component} LIBRARY COMPONENT ${component} NAMELINK_COMPONENT ${component})
  install(EXPORT mtdbTargets-${component} NAMESPACE mtdb:: DESTINATION ${MTDB_INSTALL_CMAKE}
    COMPONENT ${component})
endfunction()

mtdb_install_headers(query store codecs query)
mtdb_install_targets(query mtdb_base mtdb_store mtdb_coding mtdb_cluster mtdb_stream
  mtdb_mesh_file mtdb_codecs mtdb_query)
mtdb_install_headers(builder builder)
mtdb_install_targets(builder mtdb_builder)
install(FILES tools/client/client.h DESTINATION ${MTDB_INSTALL_HEADERS}/tools/client COMPONENT client)
mtdb_install_targets(client mtdb_client)
install(FILES query/mtdb.h DESTINATION ${MTDB_INSTALL_HEADERS}/query COMPONENT c)
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
