# Every program of examples/ answers --help, and refuses nonsense on one line.
get_property(programs DIRECTORY ${PROJECT_SOURCE_DIR}/examples PROPERTY BUILDSYSTEM_TARGETS)
# Files to read that are not a program's first argument: the options that come before them, kinds apart by "+".
set(broken_rbres_rollout "--model")
set(broken_rbres_train "--start+--resume --checkpoint+--targets broken --inputs")
# These make the folder that is their first argument.
set(refused_rbres_contacts_mujoco "broken+empty")
set(refused_rbres_web_scenes "broken+empty")
foreach(program IN LISTS programs)
  get_target_property(type ${program} TYPE)
  if(type STREQUAL "EXECUTABLE")
    add_test(NAME answers_${program} COMMAND ${CMAKE_COMMAND} -DPROGRAM=$<TARGET_FILE:${program}>
      "-DBROKEN=${broken_${program}}" "-DREFUSED=${refused_${program}}" -DWORK=${CMAKE_CURRENT_BINARY_DIR}/answers_${program}
      -P ${CMAKE_CURRENT_SOURCE_DIR}/program_answers.cmake)
  endif()
endforeach()
