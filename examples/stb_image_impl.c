/* The one place that compiles stb_image, apart from the examples so that its warnings stay out of theirs. */
#define STB_IMAGE_IMPLEMENTATION
#define STBI_NO_STDIO
#include <stb/stb_image.h>
