# What the project's own tests, examples and benchmarks are built with; users of the library never see this file.

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

option(RBRES_NATIVE "compile for this machine's processor" OFF)
option(RBRES_WERROR "treat warnings as errors" OFF)
set(RBRES_SANITIZE "" CACHE STRING "sanitizers, as in -fsanitize=")

add_library(rbres_development INTERFACE)
target_compile_options(rbres_development INTERFACE -Wall -Wextra -Wpedantic -Wconversion
  $<$<BOOL:${RBRES_WERROR}>:-Werror>
  $<$<BOOL:${RBRES_NATIVE}>:-march=native>)
# g++ 12 takes the deliberately undefined operands inside its own AVX-512 intrinsics for mistakes (GCC bug 105593).
target_compile_options(rbres_development INTERFACE
  $<$<AND:$<BOOL:${RBRES_NATIVE}>,$<CXX_COMPILER_ID:GNU>>:-Wno-uninitialized;-Wno-maybe-uninitialized>)
# GCC's note that vectors wider than the target's registers are passed in memory: nothing of ours crosses a library.
target_compile_options(rbres_development INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-psabi>)
# What users add to these, who meet the headers in their own build: linked by the headers alone and by the programs that
# instantiate most of their templates.
add_library(rbres_strict INTERFACE)
target_compile_options(rbres_strict INTERFACE -Wshadow -Wsign-conversion)
if(RBRES_SANITIZE)
  # Left out are the undefined-behaviour checks at every access to memory: what they find the address sanitizer finds too,
  # and with them the networks' kernels take minutes to compile.
  target_compile_options(rbres_development INTERFACE -fsanitize=${RBRES_SANITIZE} -fno-sanitize-recover=all
    -fno-sanitize=null,alignment,object-size,pointer-overflow,vptr)
  target_link_options(rbres_development INTERFACE -fsanitize=${RBRES_SANITIZE})
endif()

# Instruction sets to build for whatever this machine's: linked last, so that theirs is the last -march.
foreach(level sse2 avx2)
  add_library(rbres_${level} INTERFACE)
endforeach()
target_compile_options(rbres_sse2 INTERFACE -march=x86-64)
target_compile_options(rbres_avx2 INTERFACE -march=x86-64-v3)
# x86-64 with the code that serves any processor, which takes the place of SSE2's where this macro is missing.
add_library(rbres_generic INTERFACE)
target_compile_options(rbres_generic INTERFACE -march=x86-64 -U__SSE2__)

option(RBRES_QUICK_TESTS "optimise only those tests that run longer than that takes, with clang++ precompile the headers" OFF)
# rbres_precompile(NAME FLAG...): all headers for targets with these flags. (Not with g++, which reads all that it has
# precompiled for each file: that takes longer than to compile most.)
function(rbres_precompile name)
  file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/${name}.cpp CONTENT "")
  add_library(${name} OBJECT ${CMAKE_CURRENT_BINARY_DIR}/${name}.cpp)
  target_link_libraries(${name} PRIVATE rbres::rbres rbres_development)
  target_compile_options(${name} PRIVATE ${ARGN})
  target_precompile_headers(${name} PRIVATE <rbres/rbres.hpp>)
  if(TARGET rbres::io)
    target_link_libraries(${name} PRIVATE rbres::io)
    target_precompile_headers(${name} PRIVATE <rbres/io.hpp>)
  endif()
endfunction()

# rbres_program(NAME SOURCE... [LIBRARIES ...]): one executable of ours.
function(rbres_program name)
  cmake_parse_arguments(arg "" "" "LIBRARIES" ${ARGN})
  add_executable(${name} ${arg_UNPARSED_ARGUMENTS})
  target_link_libraries(${name} PRIVATE rbres::rbres rbres_development ${arg_LIBRARIES})
endfunction()

# rbres_objects(NAME SOURCE...): sources of ours that several programs link, compiled once.
function(rbres_objects name)
  add_library(${name} OBJECT ${ARGN})
  target_link_libraries(${name} PUBLIC rbres::rbres rbres_development)
endfunction()

# rbres_find_peer(TARGET HEADER LIBRARY...): an imported target if all are found. Debian's own CMake packages of
# these libraries name files of packages that they do not depend on.
function(rbres_find_peer target header)
  find_path(${target}_INCLUDE_DIR ${header})
  set(libraries)
  foreach(library IN LISTS ARGN)
    find_library(${target}_${library} ${library})
    list(APPEND libraries ${${target}_${library}})
  endforeach()
  if(${target}_INCLUDE_DIR AND NOT "${libraries}" MATCHES "NOTFOUND")
    add_library(${target} INTERFACE IMPORTED)
    target_include_directories(${target} INTERFACE ${${target}_INCLUDE_DIR})
    target_link_libraries(${target} INTERFACE ${libraries})
  endif()
endfunction()
