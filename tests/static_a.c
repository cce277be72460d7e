/* A private copy of the library; static_b.c holds another, and both link into one program. */
#define CONEMAP_STATIC
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"

#include "header.h"

float static_a_cone(const float heights[4])
{
    return header_cone(heights);
}
