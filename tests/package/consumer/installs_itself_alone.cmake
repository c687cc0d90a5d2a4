# Installs the project of folder BUILD and refuses anything but its own program.
cmake_minimum_required(VERSION 3.21)
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${BUILD}/installed COMMAND_ERROR_IS_FATAL ANY)
file(GLOB_RECURSE files RELATIVE ${BUILD}/installed ${BUILD}/installed/*)
if(NOT files MATCHES "^bin/consumer[^;]*$")
  message(FATAL_ERROR "the project installs: ${files}")
endif()
