#!/usr/bin/env bash
# Builds what the wheel's program links in place of Debian's own, into build/wheel-libraries (minutes; done once):
#   OpenCV  seven modules, static; Debian's brings windows, GDAL, GStreamer: 280 libraries, 315 MB
#   FFmpeg  only codecs and containers of files, LGPL; Debian's brings x264 and x265, which are GPL
#   libtiff no JBIG, which is GPL
#   HDF5    static, files only; Debian's brings curl, LDAP and Kerberos
#   Ceres   static, dense solvers only; Debian's brings SuiteSparse, which is GPL in part, and LAPACK
# All from Debian's source packages. scripts/packaging/make_wheels.py uses them; docs/reference/wheels.md says more.
source "$(dirname "$0")/../lib.sh"
FOLDER="$ROOT/build/wheel-libraries"
BUILD="$FOLDER/build"
JOBS=$(nproc)
KEY=$(sha256sum <"$0")
[ "$(cat "$FOLDER/ready" 2>/dev/null)" != "$KEY" ] || { echo "build/wheel-libraries: all there"; exit 0; }

say "Debian packages"
debian_packages dpkg-dev nasm pkg-config cmake ninja-build g++ libdav1d-dev libopenh264-dev libeigen3-dev \
  libjpeg-dev libpng-dev libtiff-dev libtbb-dev zlib1g-dev
say "Sources"
rm -rf "$FOLDER"
debian_source "$FOLDER" opencv ffmpeg ceres-solver hdf5 tiff

say "FFmpeg"
DECODERS=av1,ffv1,ffvhuff,gif,h264,hevc,huffyuv,libdav1d,mjpeg,mpeg1video,mpeg2video,mpeg4,png,prores,rawvideo,theora,utvideo,vp8,vp9
CONTAINERS=avi,gif,h264,hevc,matroska,mjpeg,mov,mpegps,mpegts,mpegvideo,ogg,rawvideo,image2
mkdir -p "$BUILD/ffmpeg"
(cd "$BUILD/ffmpeg" && "$FOLDER"/ffmpeg-*/configure --prefix="$FOLDER" --disable-everything --disable-autodetect \
  --disable-programs --disable-doc --disable-network --disable-avdevice --disable-avfilter --disable-postproc --disable-swresample \
  --enable-shared --disable-static --enable-pthreads --enable-zlib --enable-libdav1d --enable-libopenh264 --enable-protocol=file \
  --enable-decoder=$DECODERS --enable-encoder=ffv1,libopenh264,mjpeg,mpeg4,rawvideo \
  --enable-demuxer=$CONTAINERS --enable-muxer=avi,matroska,mov,mp4 \
  --enable-parser=av1,h264,hevc,mjpeg,mpeg4video,mpegvideo,vp8,vp9 --enable-bsf=h264_mp4toannexb,hevc_mp4toannexb,vp9_superframe,extract_extradata)
make -C "$BUILD/ffmpeg" -j "$JOBS" install

say "HDF5"
mkdir -p "$BUILD/hdf5"
(cd "$BUILD/hdf5" && "$FOLDER"/hdf5-*/configure --prefix="$FOLDER" --quiet --disable-shared --enable-static --with-pic --disable-hl \
  --disable-fortran --disable-cxx --disable-tests --disable-tools --without-szlib --enable-build-mode=production)
make -C "$BUILD/hdf5" --quiet -j "$JOBS" install

export PKG_CONFIG_PATH="$FOLDER/lib/pkgconfig"
without() { local n; for n in "$@"; do printf -- '-D%s=OFF ' "$n"; done; }

say "libtiff"
# shellcheck disable=SC2046
cmake -S "$FOLDER"/tiff-*/ -B "$BUILD/tiff" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$FOLDER" -DCMAKE_INSTALL_LIBDIR=lib \
  $(without jbig lerc lzma webp libdeflate cxx tiff-tools tiff-tests tiff-contrib tiff-docs)
cmake --build "$BUILD/tiff" -j "$JOBS" --target install

say "OpenCV"
# shellcheck disable=SC2046
cmake -S "$FOLDER"/opencv-*/ -B "$BUILD/opencv" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$FOLDER" -DCMAKE_INSTALL_LIBDIR=lib \
  -DCMAKE_PREFIX_PATH="$FOLDER" -DBUILD_LIST=core,imgproc,imgcodecs,video,videoio,highgui,calib3d,features2d,flann -DBUILD_SHARED_LIBS=OFF -DENABLE_PIC=ON \
  -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DCPU_BASELINE=SSE2,SSE3,SSSE3 -DCPU_DISPATCH=AVX2 -DENABLE_PRECOMPILED_HEADERS=OFF \
  -DWITH_FFMPEG=ON -DWITH_TBB=ON -DWITH_EIGEN=ON -DOPENCV_GENERATE_SETUPVARS=OFF -DBUILD_INFO_SKIP_TIMESTAMP=ON \
  $(without BUILD_TESTS BUILD_PERF_TESTS BUILD_EXAMPLES BUILD_opencv_apps BUILD_JAVA BUILD_opencv_python3 BUILD_ZLIB BUILD_PNG \
    BUILD_JPEG BUILD_TIFF WITH_ADE WITH_GSTREAMER WITH_GTK WITH_QT WITH_GDAL WITH_GDCM WITH_GPHOTO2 WITH_V4L WITH_1394 WITH_OPENEXR \
    WITH_JASPER WITH_OPENJPEG WITH_WEBP WITH_IPP WITH_ITT WITH_LAPACK WITH_OPENCL WITH_OPENGL WITH_PROTOBUF WITH_QUIRC WITH_VTK \
    WITH_VA WITH_VA_INTEL WITH_IMGCODEC_HDR WITH_IMGCODEC_SUNRASTER WITH_IMGCODEC_PFM)
cmake --build "$BUILD/opencv" -j "$JOBS" --target install

say "Ceres"
cmake -S "$FOLDER"/ceres-solver-*/ -B "$BUILD/ceres" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX="$FOLDER" -DCMAKE_INSTALL_LIBDIR=lib \
  -DBUILD_SHARED_LIBS=OFF -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DMINIGLOG=ON -DEIGENSPARSE=ON \
  $(without SUITESPARSE CXSPARSE LAPACK GFLAGS CUDA SCHUR_SPECIALIZATIONS BUILD_TESTING BUILD_EXAMPLES BUILD_BENCHMARKS)
cmake --build "$BUILD/ceres" -j "$JOBS" --target install

printf '%s' "$KEY" >"$FOLDER/ready"
say "build/wheel-libraries is ready"
