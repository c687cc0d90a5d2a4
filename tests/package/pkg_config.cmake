# Compiles and runs SOURCE with nothing but the compiler CXX and what pkg-config says of the installation in PREFIX.
cmake_minimum_required(VERSION 3.21)
set(ENV{PKG_CONFIG_PATH} ${PREFIX}/share/pkgconfig:$ENV{PKG_CONFIG_PATH})
execute_process(COMMAND ${PKG_CONFIG} --cflags --libs rbres OUTPUT_VARIABLE flags OUTPUT_STRIP_TRAILING_WHITESPACE
  COMMAND_ERROR_IS_FATAL ANY)
separate_arguments(flags)
foreach(flag IN LISTS flags)
  if(NOT flag MATCHES "^-I")
    message(FATAL_ERROR "rbres.pc gives ${flag}")
  endif()
endforeach()
file(MAKE_DIRECTORY ${WORK})
execute_process(COMMAND ${CXX} -std=c++20 ${flags} ${SOURCE} -o ${WORK}/consumer COMMAND_ERROR_IS_FATAL ANY COMMAND_ECHO STDOUT)
execute_process(COMMAND ${WORK}/consumer COMMAND_ERROR_IS_FATAL ANY)
