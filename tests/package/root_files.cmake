# Of the files that git knows, only these may stand at the top level of SOURCE.
cmake_minimum_required(VERSION 3.21)
set(allowed include tests examples benchmarks docs cmake CMakeLists.txt CMakePresets.json README.md CHANGELOG.md LICENSE
  .ci .clang-format .clang-tidy .gitignore)
execute_process(COMMAND ${GIT} -c safe.directory=* ls-files WORKING_DIRECTORY ${SOURCE} OUTPUT_VARIABLE files
  COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "[^\n]+" files "${files}")
list(TRANSFORM files REPLACE "/.*" "")
list(REMOVE_DUPLICATES files)
if(NOT files)
  message(FATAL_ERROR "git knows no file")
endif()
list(REMOVE_ITEM files ${allowed})
if(files)
  message(FATAL_ERROR "these do not belong at the top level: ${files}")
endif()
