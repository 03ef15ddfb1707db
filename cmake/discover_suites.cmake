# Writes a CTest file with one test per suite of a GoogleTest program: each process costs a quarter of a second to start.
# Run with -P after the program was linked; PROGRAM, OUTPUT, LABEL.
execute_process(COMMAND ${PROGRAM} --gtest_list_tests OUTPUT_VARIABLE listed RESULT_VARIABLE result)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "${PROGRAM} --gtest_list_tests failed: ${result}")
endif()
string(REPLACE "\n" ";" lines "${listed}")
set(text "")
foreach(line IN LISTS lines)
  if(line MATCHES "^([^ ]+)\\.( |$)")
    set(suite ${CMAKE_MATCH_1})
    string(APPEND text "add_test([==[${suite}]==] [==[${PROGRAM}]==] [==[--gtest_filter=${suite}.*]==])\n"
                       "set_tests_properties([==[${suite}]==] PROPERTIES LABELS ${LABEL} TIMEOUT 400 SKIP_RETURN_CODE 77 "
                       "ENVIRONMENT COUNTERSHADE_SKIPPED_RETURNS=77)\n")
  endif()
endforeach()
file(WRITE ${OUTPUT} "${text}")
