# The house: arrows between folders, one namespace, headers that stand alone, what must not compile.
add_test(NAME include_arrows
  COMMAND ${CMAKE_COMMAND} -DINCLUDE=${PROJECT_SOURCE_DIR}/include -P ${CMAKE_CURRENT_SOURCE_DIR}/include_arrows.cmake)
add_test(NAME inline_namespace
  COMMAND ${CMAKE_COMMAND} -DINCLUDE=${PROJECT_SOURCE_DIR}/include -P ${CMAKE_CURRENT_SOURCE_DIR}/inline_namespace.cmake)

file(GLOB_RECURSE headers CONFIGURE_DEPENDS RELATIVE ${PROJECT_SOURCE_DIR}/include ${PROJECT_SOURCE_DIR}/include/rbres/*.hpp)
if(TARGET rbres::io)
  set(library rbres::io)
else()
  set(library rbres::rbres)
  list(FILTER headers EXCLUDE REGEX "rbres/io")
endif()
set(alone "")
foreach(header IN LISTS headers)
  string(MAKE_C_IDENTIFIER ${header} name)
  set(source ${CMAKE_CURRENT_BINARY_DIR}/self_contained/${name}.cpp)
  file(CONFIGURE OUTPUT ${source} CONTENT "#include <${header}>\n" @ONLY)
  list(APPEND alone ${source})
endforeach()
add_library(rbres_self_contained OBJECT EXCLUDE_FROM_ALL ${alone})
target_link_libraries(rbres_self_contained PRIVATE ${library} rbres_development rbres_strict)

get_target_property(eigen_folders Eigen3::Eigen INTERFACE_INCLUDE_DIRECTORIES)
# rbres_compile_test(NAME SOURCE ERROR [FLAG]): compiling the source must end with the error; "" for none.
function(rbres_compile_test name source error)
  add_test(NAME compile_${name} COMMAND ${CMAKE_CXX_COMPILER} -std=c++20 -fsyntax-only -I${PROJECT_SOURCE_DIR}/include
    -I${eigen_folders} ${CMAKE_CURRENT_SOURCE_DIR}/compile_fail/${source} ${ARGN})
  if(error)
    set_tests_properties(compile_${name} PROPERTIES PASS_REGULAR_EXPRESSION "${error}")
  endif()
endfunction()
rbres_compile_test(known_pair missing_pair.cpp "" -DRBRES_KNOWN_PAIR)
rbres_compile_test(missing_pair missing_pair.cpp "no matching function for call to [^\n]*detect")
rbres_compile_test(fast_math missing_pair.cpp "compile without -ffast-math" -DRBRES_KNOWN_PAIR -ffast-math)
rbres_compile_test(fast_math_finite missing_pair.cpp "" -DRBRES_KNOWN_PAIR -ffast-math -fno-finite-math-only)
rbres_compile_test(observer observer.cpp "")
rbres_compile_test(observer_other_arguments observer.cpp "called as .double time" -DRBRES_OTHER_ARGUMENTS)
rbres_compile_test(observer_changes_the_state observer.cpp "called as .double time" -DRBRES_CHANGES_THE_STATE)
rbres_compile_test(observer_returns_a_number observer.cpp "returns nothing, or bool" -DRBRES_RETURNS_A_NUMBER)
rbres_compile_test(observer_other_impact observer.cpp "impact is called as" -DRBRES_OTHER_IMPACT)
rbres_compile_test(train_whole_weights train_half.cpp "")
rbres_compile_test(train_half_weights train_half.cpp "train a network of whole ones" -DRBRES_WEIGHTS=rbres::bfloat16)

# The proof that comes with the library, as a test.
if(TARGET rbres_validate)
  add_test(NAME validate COMMAND rbres_validate)
endif()
