# PROGRAM from outside: --help says what it takes; what it does not take, numbers that make no sense and files that are
# missing or broken are refused, each on one line; a full disk under its output is no success. BROKEN: options that take
# a file to read, each with those it needs; REFUSED: what is no first argument, by default all of the four below.
cmake_minimum_required(VERSION 3.21)
get_filename_component(name ${PROGRAM} NAME)
file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK}/folder)
file(WRITE ${WORK}/broken "neither a model nor an array")
file(WRITE ${WORK}/empty "")

# refuses(PART ARGUMENT...): one line, which begins with the program's name and matches PART; nothing is written.
function(refuses part)
  execute_process(COMMAND ${PROGRAM} ${ARGN} WORKING_DIRECTORY ${WORK} TIMEOUT 60
    RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE err)
  file(GLOB_RECURSE files LIST_DIRECTORIES true RELATIVE ${WORK} ${WORK}/*)
  if(NOT status EQUAL 2 OR NOT err MATCHES "^${name}: [^\n]+\n$" OR NOT err MATCHES "${part}")
    message(SEND_ERROR "${name} ${ARGN}: expected status 2 and one line with '${part}', found ${status} and:\n${err}")
  endif()
  if(NOT "${out}" STREQUAL "")
    message(SEND_ERROR "${name} ${ARGN}: it is refused after output:\n${out}")
  endif()
  if(NOT files STREQUAL "broken;empty;folder")
    message(FATAL_ERROR "${name} ${ARGN}: it is refused, but leaves files: ${files}")
  endif()
endfunction()

foreach(flag --help -h)
  execute_process(COMMAND ${PROGRAM} ${flag} WORKING_DIRECTORY ${WORK} TIMEOUT 60
    RESULT_VARIABLE status OUTPUT_VARIABLE help ERROR_VARIABLE err)
  if(NOT status EQUAL 0 OR NOT err STREQUAL "" OR NOT help MATCHES "[Uu]sage: .*${name}")
    message(SEND_ERROR "${name} ${flag}: expected status 0 and its usage, found ${status} and:\n${help}${err}")
  endif()
endforeach()

if(EXISTS /dev/full)
  execute_process(COMMAND ${PROGRAM} --help WORKING_DIRECTORY ${WORK} TIMEOUT 60
    RESULT_VARIABLE status OUTPUT_FILE /dev/full ERROR_VARIABLE err)
  if(NOT status EQUAL 2 OR NOT err MATCHES "^${name}: cannot write to stdout: [^\n]+\n$")
    message(SEND_ERROR "${name} --help >/dev/full: expected status 2 and one line, found ${status} and:\n${err}")
  endif()
endif()

refuses("--nonsense|is required" --nonsense)
refuses("--nonsense|is required" --nonsense=1)
if(NOT REFUSED)
  set(REFUSED "missing+broken+empty+folder")
endif()
string(REPLACE "+" ";" arguments "${REFUSED}")
foreach(argument IN LISTS arguments)
  refuses("${argument}" ${argument})
endforeach()
# A program that takes a file or a folder reads that first; the second is too many for all of them.
refuses("broken|missing" broken missing)

string(REGEX MATCHALL "--[a-z0-9-]+ (FLOAT|INT|UINT)" options "${help}")
foreach(option IN LISTS options)
  string(REGEX REPLACE " .*" "" option ${option})
  foreach(value nan -1 1e300 abc 1x "")
    refuses("${option}" folder "${option}=${value}")
  endforeach()
endforeach()
string(REGEX MATCHALL "[^+]+" all "${BROKEN}")
foreach(options IN LISTS all)
  separate_arguments(options UNIX_COMMAND "${options}")
  foreach(file missing broken empty folder)
    refuses("${file}" ${options} ${file})
  endforeach()
endforeach()
