# A Debian package for any architecture: cpack --config CPackConfig.cmake, in the build folder.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME librbres-dev)
set(CPACK_PACKAGE_CONTACT "The rbres authors")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION "A simulator of rigid bodies with contacts and friction, and networks that learn
their motion, as headers that inline into C++20 programs.")
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "libeigen3-dev (>= ${rbres_eigen_minimum})")
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS nlohmann-json3-dev)  # for rbres::io
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "cmake, pkg-config")

# Debian looks for the licence under the package's name.
set(documents ${CMAKE_CURRENT_BINARY_DIR}/deb)
configure_file(LICENSE ${documents}/copyright COPYONLY)
set(CPACK_INSTALLED_DIRECTORIES ${documents} usr/share/doc/${CPACK_PACKAGE_NAME})
include(CPack)
