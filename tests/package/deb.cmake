# Makes the Debian package of the build BUILD, unpacks it with DPKG_DEB under WORK/root, and looks at what it says and holds:
# what an installation holds (SAME), and the licence.
cmake_minimum_required(VERSION 3.21)
file(REMOVE_RECURSE ${WORK})
execute_process(COMMAND ${CMAKE_CPACK_COMMAND} --config ${BUILD}/CPackConfig.cmake -B ${WORK}
  OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
set(package ${WORK}/librbres-dev_${VERSION}_all.deb)

function(expect_field field expected)
  execute_process(COMMAND ${DPKG_DEB} --field ${package} ${field} OUTPUT_VARIABLE found
    OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
  if(NOT found MATCHES "^${expected}$")
    message(FATAL_ERROR "${field}: expected ${expected}, found '${found}'")
  endif()
endfunction()
expect_field(Package librbres-dev)
expect_field(Version ${VERSION})
expect_field(Architecture all)
expect_field(Section libdevel)
expect_field(Depends "libeigen3-dev .>= [0-9.]+.")
expect_field(Recommends nlohmann-json3-dev)
expect_field(Suggests "cmake, pkg-config")
expect_field(Description "Rigid-body simulation[^\n]*\n A simulator of rigid bodies.*C.*20 programs.")

execute_process(COMMAND ${DPKG_DEB} --extract ${package} ${WORK}/root COMMAND_ERROR_IS_FATAL ANY)
file(GLOB_RECURSE installed RELATIVE ${SAME} ${SAME}/*)
file(GLOB_RECURSE packaged RELATIVE ${WORK}/root/usr ${WORK}/root/*)
list(APPEND installed share/doc/librbres-dev/copyright)
list(SORT installed)
list(SORT packaged)
if(NOT packaged STREQUAL installed)
  message(FATAL_ERROR "the package holds\n${packaged}\nand an installation holds\n${installed}")
endif()
