# Embeds every shader of FOLDER into TARGET: shader_source("name.comp") of solver/runtime/shader.h finds it by file name.
function(embed_shaders TARGET FOLDER)
  file(GLOB shaders CONFIGURE_DEPENDS ${FOLDER}/*.comp ${FOLDER}/*.frag ${FOLDER}/*.vert ${FOLDER}/*.glsl)
  set(output ${CMAKE_CURRENT_BINARY_DIR}/embedded_shaders.cpp)
  add_custom_command(OUTPUT ${output}
    COMMAND ${CMAKE_COMMAND} -DOUTPUT=${output} "-DSHADERS=${shaders}" -P ${PROJECT_SOURCE_DIR}/cmake/write_shaders.cmake
    DEPENDS ${shaders} ${PROJECT_SOURCE_DIR}/cmake/write_shaders.cmake VERBATIM)
  target_sources(${TARGET} PRIVATE ${output})
endfunction()
