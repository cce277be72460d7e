#!/bin/sh
# The example programs as a person runs them: good files work; a bad file or option gets one clear line and a non-zero
# exit status.
cd "$(dirname "$0")/.." || exit 1
make -s -j2 build/hello build/bake build/render build/inspect build/accuracy build/tree build/emit || exit 1
dir=$(mktemp -d) || exit 1
trap 'rm -rf "$dir"' EXIT
map=examples/jacksboro_403x344_16bit.pgm
failed=0

say() {
    echo "FAILED: $*"
    failed=1
}

# refuses COMMAND...: fails with exactly one line on stderr, which names no crash.
refuses() {
    "$@" >"$dir/stdout" 2>"$dir/stderr"
    status=$?
    lines=$(wc -l <"$dir/stderr")
    if [ $status = 0 ] || [ $status -ge 126 ] || [ "$lines" != 1 ]; then
        say "$* -> status $status, $lines lines: $(cat "$dir/stderr")"
    else
        echo "refused: $(cat "$dir/stderr")"
    fi
}

works() {
    "$@" >"$dir/stdout" 2>"$dir/stderr" || say "$* -> $(cat "$dir/stderr")"
}

works build/hello
works build/emit --help
works build/emit --dialect hlsl50 --tracer exact --stage compute
grep -q numthreads "$dir/stdout" || say "emit prints no compute shader"
works build/emit --frusta relief --stage fragment
grep -q gl_FragDepth "$dir/stdout" || say "emit prints no shader for frusta"
works build/emit --frusta relief --stage fragment --effects shadow,fade,depth
grep -q hit.shadow "$dir/stdout" || say "emit prints no effects of frusta"
refuses build/emit --frusta relief --effects curved
refuses build/emit --stage vertex
works build/emit --kernel quick --generator quick-center --dialect glsl430 --stage compute
grep -q conemap_quick "$dir/stdout" || say "emit prints no kernel"
refuses build/emit --kernel relaxed
works build/emit --effects shadow,depth,uv --stage fragment --dialect vulkan --depth-bound greater
works build/emit --dialect wgsl --tracer maxmip --stage compute --status 1
works build/emit --dialect msl --effects shadow,normal --stage fragment
grep -q conemap_shade "$dir/stdout" || say "emit prints no effects"
refuses build/emit --effects sparkle
refuses build/emit --dialect cobol
refuses build/emit --tracer
refuses build/emit --stage compute
refuses build/emit --max-steps many
for program in bake render inspect; do
    works build/$program --help
    [ -s "$dir/stdout" ] || say "$program --help says nothing"
    refuses build/$program
    refuses build/$program --no-such-option
    refuses build/$program "$dir/there-is-no-such-file.pgm" -o "$dir/x"
done

: >"$dir/empty.pgm"
: >"$dir/empty.cone"
head -c 1000 $map >"$dir/cut.pgm"
head -c 9 $map >"$dir/cut-header.pgm"
echo "this is not a picture" >"$dir/wrong.pgm"
printf 'P5 99999999 99999999 255\n' >"$dir/huge.pgm"
printf 'Pf 2 2 -1.0\n\000\000\300\177\000\000\300\177\000\000\300\177\000\000\300\177' >"$dir/nan.pfm"
works build/bake $map -o "$dir/good.cone"
head -c 5000 "$dir/good.cone" >"$dir/cut.cone"
{ head -c 5000 "$dir/good.cone"; printf 'X'; tail -c +5002 "$dir/good.cone"; } >"$dir/damaged.cone"
for bad in empty.pgm cut.pgm cut-header.pgm wrong.pgm huge.pgm nan.pfm; do refuses build/bake "$dir/$bad" -o "$dir/x.cone"; done
for bad in empty.cone cut.cone damaged.cone; do
    refuses build/render "$dir/$bad" -o "$dir/x.png"
    refuses build/inspect "$dir/$bad" -o "$dir/x-"
    [ $bad = damaged.cone ] || refuses build/bake --info "$dir/$bad"
done
refuses build/bake $map -o "$dir/no/such/folder/x.cone"
refuses build/bake $map -o "$dir/x.cone" --generator fastest
refuses build/bake $map -o "$dir/x.cone" --max-tan many
refuses build/bake $map -o "$dir/x.cone" --max-tan -1

# Every generator, format, encoding and layout can be asked for, and what is baked renders.
printf 'P2 4 3 9\n0 1 2 3\n4 5 6 7\n8 9 0 1\n' >"$dir/tiny.pgm"
works build/bake "$dir/tiny.pgm" -o "$dir/t.cone" --guarantee vertex --slack 0.5
works build/bake --verify "$dir/good.cone"
for sectors in 1 4 8; do
    works build/bake --verify "$dir/tiny.pgm" -o "$dir/s.cone" --raw "$dir/s.bin" --sectors $sectors
    works build/bake --info "$dir/s.cone"
    works build/inspect "$dir/s.cone" -o "$dir/s-"
    works build/render "$dir/s.cone" -o "$dir/s.ppm" --size 32x24
done
refuses build/bake "$dir/tiny.pgm" -o "$dir/s.cone" --sectors 3
refuses build/bake "$dir/tiny.pgm" -o "$dir/s.cone" --sectors 4 --generator quick
works build/bake --verify "$dir/tiny.pgm" -o "$dir/t.cone" --format unorm8
refuses build/bake --verify $map -o "$dir/t.cone" --guarantee vertex
refuses build/bake "$dir/tiny.pgm" -o "$dir/t.cone" --guarantee bilinear --generator ring
for generator in exact ring quick quick-naive quick-center quick-naive-center relaxed relaxed-sampled hybrid; do
    works build/bake "$dir/tiny.pgm" -o "$dir/t.cone" --generator $generator --min3x3
    works build/render "$dir/t.cone" -o "$dir/t.png" --size 16x16
done
for format in f32 f16 unorm16 unorm8; do
    for encoding in linear sqrt radius; do
        for layout in height-cone cone dummer; do
            works build/bake "$dir/tiny.pgm" -o "$dir/t.cone" --format $format --encoding $encoding --layout $layout
            works build/bake --info "$dir/t.cone"
            grep -q $format "$dir/stdout" || say "--info does not tell the format $format"
        done
    done
done
for tracer in exact linear fixed loop exact-step cell-max maxmip qdm; do
    works build/render "$dir/good.cone" -o "$dir/t.png" --size 32x32 --tracer $tracer --refine bisect
done
works build/accuracy --help
refuses build/accuracy --no-such-option
refuses build/accuracy --size many
refuses build/accuracy "$dir/cut.pgm" --no-pictures
works build/tree --help
works build/tree well cacti --size 24x16 --samples 1 --frames 2 -o "$dir"
[ -s "$dir/cacti-1.png" ] || say "tree draws no second frame"
refuses build/tree --march fastest
refuses build/tree no-such-model
refuses build/tree well --size 8x8 -o "$dir/no/such/folder"
[ $failed = 0 ] && echo "examples: all as they should be"
exit $failed
