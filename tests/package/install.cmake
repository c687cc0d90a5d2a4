# Installs the build BUILD of the sources SOURCE under WORK, and moves it to PREFIX: the installed files must not care.
cmake_minimum_required(VERSION 3.21)
file(REMOVE_RECURSE ${WORK})
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/installed
  OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
file(RENAME ${WORK}/installed ${PREFIX})

file(GLOB_RECURSE files ${PREFIX}/*)
file(GLOB_RECURSE headers ${PREFIX}/include/rbres/*.hpp)
if(NOT headers)
  message(FATAL_ERROR "no header was installed")
endif()
foreach(file IN LISTS files)
  file(READ ${file} text)
  foreach(path IN ITEMS ${SOURCE} ${BUILD} ${WORK})
    string(FIND "${text}" ${path} at)
    if(NOT at EQUAL -1)
      message(FATAL_ERROR "${file} names ${path}, so it works on this machine alone")
    endif()
  endforeach()
endforeach()

# As a project for 32 bits would read it.
set(CMAKE_SIZEOF_VOID_P 4)
include(${PREFIX}/share/cmake/rbres/rbresConfigVersion.cmake)
if(PACKAGE_VERSION_UNSUITABLE)
  message(FATAL_ERROR "the version file refuses another architecture: ${PACKAGE_VERSION}")
endif()
