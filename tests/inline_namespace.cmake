# Checks that what include/rbres declares stands in the inline namespace of core/abi.hpp, but for Error.
# Run as: cmake -DINCLUDE=<the include folder> -P inline_namespace.cmake

cmake_policy(VERSION 3.21)

file(GLOB_RECURSE headers RELATIVE ${INCLUDE}/rbres ${INCLUDE}/rbres/*.hpp)
if(NOT headers)
  message(FATAL_ERROR "no headers under ${INCLUDE}/rbres")
endif()
set(wrong "")
foreach(header IN LISTS headers)
  file(STRINGS ${INCLUDE}/rbres/${header} openings REGEX "^namespace rbres")
  file(STRINGS ${INCLUDE}/rbres/${header} includes REGEX "^#include <rbres/")
  if(openings AND NOT includes)
    string(APPEND wrong "  ${header}: no header that defines RBRES_ABI is included\n")
  endif()
  foreach(line IN LISTS openings)
    if(NOT line MATCHES "^namespace rbres::RBRES_ABI(::[a-z]+)? {$"
       AND NOT (header STREQUAL "core/error.hpp" AND line STREQUAL "namespace rbres {"))
      string(APPEND wrong "  ${header}: ${line}\n")
    endif()
  endforeach()
endforeach()
if(wrong)
  message(FATAL_ERROR "outside of the inline namespace:\n${wrong}")
endif()
