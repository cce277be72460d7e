#!/bin/sh
# The main job on the shipped elevation model and on two procedural maps: bake, look inside, render.
set -e
map=examples/jacksboro_403x344_16bit.pgm
bin=build
out=out
mkdir -p $out

echo "Elevation model (Jacksboro, Tennessee; USGS SRTM)"
$bin/bake $map --aspect square -o $out/jacksboro.cone
$bin/render $out/jacksboro.cone --depth 0.22 -o $out/jacksboro.png
$bin/render $out/jacksboro.cone --depth 0.22 --mode steps -o $out/jacksboro-steps.png
$bin/render $out/jacksboro.cone --depth 0.22 --mode unconverged --tracer loop --max-steps 32 \
    -o $out/jacksboro-unconverged.png
$bin/render $out/jacksboro.cone --depth 0.22 --mode difference -o $out/jacksboro-difference.png
$bin/inspect $out/jacksboro.cone -o $out/jacksboro-

echo "Procedural maps"
$bin/bake --procedural bricks 512 --wrap wrap --format unorm16 --encoding sqrt --layout dummer \
    -o $out/bricks.cone
$bin/render $out/bricks.cone --tile --depth 0.05 --palette clay --elevation 25 -o $out/bricks.png
$bin/bake --procedural fbm 512 --wrap wrap --format f16 -o $out/fbm.cone
$bin/render $out/fbm.cone --depth 0.3 -o $out/fbm.png

echo "The pictures are in $out/:"
ls $out/*.png
