# Headers, the CMake package and the pkg-config file. All of it can be moved after installation, and none of it depends
# on the architecture, so it goes to share/.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(package_dir ${CMAKE_INSTALL_DATADIR}/cmake/rbres)

install(DIRECTORY include/rbres DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})

# Two sets, so that rbres::io exists only where what it needs was found.
install(TARGETS rbres EXPORT rbresTargets INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(TARGETS rbres_io EXPORT rbresIoTargets)
install(EXPORT rbresTargets NAMESPACE rbres:: DESTINATION ${package_dir})
install(EXPORT rbresIoTargets NAMESPACE rbres:: DESTINATION ${package_dir})

# Below 1.0 a minor version may break what the one before promised.
configure_package_config_file(cmake/rbresConfig.cmake.in rbresConfig.cmake INSTALL_DESTINATION ${package_dir}
  NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(rbresConfigVersion.cmake COMPATIBILITY SameMinorVersion ARCH_INDEPENDENT)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/rbresConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/rbresConfigVersion.cmake
  DESTINATION ${package_dir})

file(RELATIVE_PATH rbres_include_from_pc ${CMAKE_INSTALL_FULL_DATADIR}/pkgconfig ${CMAKE_INSTALL_FULL_INCLUDEDIR})
configure_file(cmake/rbres.pc.in rbres.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/rbres.pc DESTINATION ${CMAKE_INSTALL_DATADIR}/pkgconfig)
