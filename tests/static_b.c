/* A private copy of the library; static_a.c holds another, and both link into one program. */
#define CONEMAP_STATIC
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"

#include "header.h"

float static_b_cone(const float heights[4])
{
    return header_cone(heights);
}
