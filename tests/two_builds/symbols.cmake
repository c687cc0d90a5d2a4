# Checks that two objects define no function or constant of rbres by the same name, but for Error, whose code no
# instruction set changes. Run as: cmake -DNM=<nm> -DPLAIN=<object> -DWIDE=<object> -P symbols.cmake

cmake_policy(VERSION 3.21)

foreach(object IN ITEMS PLAIN WIDE)
  execute_process(COMMAND ${NM} --defined-only --format=posix ${${object}} OUTPUT_VARIABLE names
    COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCHALL "_Z[^ \n]*5rbres[^ \n]*" ${object} "${names}")
  list(FILTER ${object} EXCLUDE REGEX "5rbres5Error")
  if(NOT ${object})
    message(FATAL_ERROR "one object defines nothing of rbres")
  endif()
endforeach()
set(both "")
foreach(name IN LISTS PLAIN)
  if(name IN_LIST WIDE)
    string(APPEND both "  ${name}\n")
  endif()
endforeach()
if(both)
  message(FATAL_ERROR "both objects define:\n${both}")
endif()
