/* A part of a JPEG's pixels, by libjpeg-turbo: the only decoder that skips rows and columns.

   Rows above the part are read but not transformed, rows below it are not read at all, so faults
   of the data down there are not seen. The part is decoded with a margin of one block of the
   picture's grid (MCU), since colours are interpolated between blocks: its pixels are those of the
   whole picture. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <setjmp.h>
#include <stdio.h>
#include <string.h>

#include <jpeglib.h>

#include <jerror.h>

#ifndef LIBJPEG_TURBO_VERSION
#error "only libjpeg-turbo skips and crops"
#endif

#define CHANNELS 3
#define ROWS_AT_ONCE 4
/* Each scan of a progressive picture costs time; no encoder makes more than a few dozen. */
#define MOST_SCANS 200

typedef struct {
    struct jpeg_error_mgr manager;
    jmp_buf escape;
    char message[JMSG_LENGTH_MAX];
} Failure;

typedef struct {
    unsigned int x0, y0, x1, y1;
} Box;

static void fail(j_common_ptr decoder)
{
    Failure *failure = (Failure *)decoder->err;
    failure->manager.format_message(decoder, failure->message);
    longjmp(failure->escape, 1);
}

/* A warning is told of data that are corrupt; but cameras pad their scans, which is not. */
static void judge_message(j_common_ptr decoder, int level)
{
    if (level < 0 && decoder->err->msg_code != JWRN_EXTRANEOUS_DATA)
        fail(decoder);
}

static void count_scans(j_common_ptr decoder)
{
    if (((j_decompress_ptr)decoder)->input_scan_number > MOST_SCANS)
        ERREXIT(decoder, JERR_NOT_COMPILED);
}

static void refuse(Failure *failure, const char *message)
{
    strncpy(failure->message, message, JMSG_LENGTH_MAX - 1);
    longjmp(failure->escape, 1);
}

/* Whether the sampling is one of those that every camera and encoder uses: 4:4:4, 4:2:2, 4:2:0. */
static int is_usual(const struct jpeg_decompress_struct *decoder)
{
    const jpeg_component_info *each = decoder->comp_info;
    return decoder->num_components == CHANNELS &&
           each[0].h_samp_factor <= 2 && each[0].v_samp_factor <= 2 &&
           each[1].h_samp_factor == 1 && each[1].v_samp_factor == 1 &&
           each[2].h_samp_factor == 1 && each[2].v_samp_factor == 1;
}

static void read_part(struct jpeg_decompress_struct *decoder, Box box, unsigned char *pixels)
{
    const size_t stride = (size_t)CHANNELS * (box.x1 - box.x0);
    JDIMENSION left = 0, width = decoder->output_width;
    JSAMPARRAY rows;
    JSAMPROW direct[ROWS_AT_ONCE];
    int is_direct;

    if (is_usual(decoder)) {
        const JDIMENSION across = DCTSIZE * decoder->max_h_samp_factor;
        const JDIMENSION down = DCTSIZE * decoder->max_v_samp_factor;
        const JDIMENSION right = box.x1 + across < width ? box.x1 + across : width;
        if (box.x0 > across || right < width) {
            left = box.x0 > across ? box.x0 - across : 0;
            width = right - left;
            jpeg_crop_scanline(decoder, &left, &width);
        }
        if (box.y0 / down > 1)
            jpeg_skip_scanlines(decoder, (box.y0 / down - 1) * down);
    }
    is_direct = left == box.x0 && width == box.x1 - box.x0;
    rows = decoder->mem->alloc_sarray((j_common_ptr)decoder, JPOOL_IMAGE,
                                      CHANNELS * width, ROWS_AT_ONCE);
    while (decoder->output_scanline < box.y1) {
        const JDIMENSION first = decoder->output_scanline;
        JDIMENSION count = box.y1 - first < ROWS_AT_ONCE ? box.y1 - first : ROWS_AT_ONCE;
        if (is_direct && first >= box.y0) {
            for (JDIMENSION k = 0; k < count; k++)
                direct[k] = pixels + (first + k - box.y0) * stride;
            jpeg_read_scanlines(decoder, direct, count);
            continue;
        }
        count = jpeg_read_scanlines(decoder, rows, count);
        for (JDIMENSION k = 0; k < count; k++)
            if (first + k >= box.y0)
                memcpy(pixels + (first + k - box.y0) * stride,
                       rows[k] + (size_t)CHANNELS * (box.x0 - left), stride);
    }
    if (decoder->output_scanline == decoder->output_height)
        jpeg_finish_decompress(decoder);
}

/* Decode the box of a picture of that size; 0, or -1 with the failure's message. */
static int decode(const Py_buffer *data, JDIMENSION width, JDIMENSION height, Box box,
                  unsigned char *pixels, Failure *failure)
{
    struct jpeg_decompress_struct decoder;
    struct jpeg_progress_mgr progress;

    memset(&decoder, 0, sizeof decoder);
    memset(&progress, 0, sizeof progress);
    decoder.err = jpeg_std_error(&failure->manager);
    failure->manager.error_exit = fail;
    failure->manager.emit_message = judge_message;
    if (setjmp(failure->escape)) {
        jpeg_destroy_decompress(&decoder);
        return -1;
    }
    jpeg_create_decompress(&decoder);
    progress.progress_monitor = count_scans;
    decoder.progress = &progress;
    jpeg_mem_src(&decoder, data->buf, (unsigned long)data->len);
    jpeg_read_header(&decoder, TRUE);
    if (decoder.image_width != width || decoder.image_height != height)
        refuse(failure, "two headers of different sizes");
    if (decoder.num_components != 1 && decoder.num_components != CHANNELS)
        refuse(failure, "its colours are neither one nor three");
    decoder.out_color_space = JCS_EXT_BGR;
    jpeg_start_decompress(&decoder);
    read_part(&decoder, box, pixels);
    jpeg_destroy_decompress(&decoder);
    return 0;
}

static PyObject *decode_part(PyObject *module, PyObject *arguments)
{
    Py_buffer data, pixels;
    unsigned int width, height;
    Box box;
    Failure failure;
    int status = -1;

    (void)module;
    if (!PyArg_ParseTuple(arguments, "y*w*(II)(IIII)", &data, &pixels, &width, &height, &box.x0,
                          &box.y0, &box.x1, &box.y1))
        return NULL;
    memset(&failure, 0, sizeof failure);
    if (!(box.x0 < box.x1 && box.x1 <= width && box.y0 < box.y1 && box.y1 <= height) ||
        (size_t)pixels.len != (size_t)CHANNELS * (box.x1 - box.x0) * (box.y1 - box.y0)) {
        strncpy(failure.message, "the box, the picture and the pixels do not fit", JMSG_LENGTH_MAX);
    } else {
        Py_BEGIN_ALLOW_THREADS
        status = decode(&data, width, height, box, pixels.buf, &failure);
        Py_END_ALLOW_THREADS
    }
    PyBuffer_Release(&data);
    PyBuffer_Release(&pixels);
    if (status) {
        PyErr_SetString(PyExc_ValueError, failure.message);
        return NULL;
    }
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"decode_part", decode_part, METH_VARARGS,
     "decode_part(data, pixels, (width, height), (x0, y0, x1, y1))\n\n"
     "Decode a box of a JPEG of that size to pixels, a buffer of (y1 - y0, x1 - x0, 3)\n"
     "uint8, blue-green-red. Raises ValueError where the data is corrupt."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_partial", NULL, -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__partial(void)
{
    return PyModule_Create(&definition);
}
