"""Pictures go through as they came, and nonsense is told from them."""

from __future__ import annotations

import json
import math

import pytest

from binopos_ros.bag.definitions import jazzy
from binopos_ros.bag.messages import COMPRESSED_IMAGE, compressed_image
from binopos_ros.view.errors import ViewError
from binopos_ros.view.wire import (
    Picture,
    picture_frame,
    read_picture_frame,
    read_request,
    serialized_picture,
    text,
)

STAMP = 1_700_000_004_966_666_667
JPEG = b'\xff\xd8' + bytes(range(256)) * 9 + b'\xff\xd9'


@pytest.mark.parametrize('frame_id', ['', 'a', 'left', 'left_camera_optical_frame'])
@pytest.mark.parametrize('form', ['jpeg', 'bgr8; jpeg compressed bgr8'])
def test_the_jpeg_in_a_serialised_message_is_found_to_the_byte(frame_id, form):
    message = compressed_image(STAMP, frame_id, JPEG, form)
    data = bytes(jazzy().serialize_cdr(message, COMPRESSED_IMAGE))
    picture = serialized_picture('right', data)
    assert (picture.side, picture.stamp) == ('right', STAMP)
    assert bytes(picture.jpeg) == JPEG


def test_every_message_that_is_cut_short_is_refused():
    message = compressed_image(STAMP, 'left', JPEG[:40])
    data = bytes(jazzy().serialize_cdr(message, COMPRESSED_IMAGE))
    for length in range(len(data) - 4):
        with pytest.raises(ViewError):
            serialized_picture('left', data[:length])


def test_what_is_no_jpeg_is_refused():
    data = bytes(jazzy().serialize_cdr(compressed_image(1, '', b'\x89PNG'), COMPRESSED_IMAGE))
    with pytest.raises(ViewError, match='no JPEG'):
        serialized_picture('left', data)


def test_a_frame_is_read_as_it_was_written():
    picture = read_picture_frame(picture_frame(Picture('right', STAMP, JPEG)))
    assert (picture.side, picture.stamp, bytes(picture.jpeg)) == ('right', STAMP, JPEG)
    drawn = read_picture_frame(picture_frame(Picture('left', 1, JPEG, drawn=True)))
    assert (drawn.side, drawn.drawn, picture.drawn) == ('left', True, False)
    for nonsense in (b'', b'BPV1', b'x' * 40, b'BPV1\x03' + bytes(20)):
        with pytest.raises(ViewError):
            read_picture_frame(nonsense)


def test_what_is_not_finite_is_null():
    told = json.loads(text('state', {'a': math.nan, 'b': [math.inf, 1.5], 'c': {'d': -math.inf}}))
    assert told == {'type': 'state', 'a': None, 'b': [None, 1.5], 'c': {'d': None}}


@pytest.mark.parametrize('words', ['', '{', '[]', '3', '{"type": 3}', '{}', '[' * 900])
def test_requests_that_are_none_are_refused(words):
    with pytest.raises(ViewError):
        read_request(words)
