"""Pictures as people have them: other names and layouts, damaged files, boards that look alike."""

from __future__ import annotations

import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from binopos_ros.bag import BagWriter, messages
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView, find_board, upright_like
from binopos_ros.calibration.views.gather import find_boards
from binopos_ros.calibration.views.pictures import Pictures, grey_picture
from binopos_ros.cli.calibration_bags import open_pictures
from binopos_ros.detection.images import RawImage


def plain(value: int, shape: tuple[int, int] = (24, 32)) -> np.ndarray:
    return np.full(shape, value, np.uint8)


def save(path: Path, value: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), plain(value))


def values(pictures: Pictures) -> list[tuple[int, int]]:
    return [(int(p.left()[0, 0]), int(p.right()[0, 0])) for p in pictures.pairs]


@pytest.mark.parametrize(
    ('left', 'right'),
    [
        ('cam0/data/{:04d}.png', 'cam1/data/{:04d}.png'),
        ('cam0/image_{:04d}.png', 'cam1/image_{:04d}.png'),
        ('image_00/{}.png', 'image_01/{}.png'),
        ('L/{}.png', 'R/{}.png'),
        ('left_camera/a{}.png', 'right_camera/a{}.png'),
        ('cam0_{}.png', 'cam1_{}.png'),
        ('L{}.png', 'R{}.png'),
        ('bright {} left.png', 'bright {} right.png'),
        ('{}-LEFT.png', '{}-RIGHT.png'),
    ],
)
def test_names_tell_the_sides(tmp_path: Path, left: str, right: str) -> None:
    for i in (1, 2, 10):
        save(tmp_path / left.format(i), i)
        save(tmp_path / right.format(i), 100 + i)
    assert values(open_pictures(tmp_path)) == [(1, 101), (2, 102), (10, 110)]


def test_a_folder_that_tells_no_side_says_what_to_do(tmp_path: Path) -> None:
    for i in range(3):
        save(tmp_path / f'image_{i}.png', i)
    with pytest.raises(CalibrationError, match='--layout side-by-side or top-bottom'):
        open_pictures(tmp_path)


@pytest.mark.parametrize(('layout', 'axis'), [('side-by-side', 1), ('top-bottom', 0)])
def test_both_views_in_one_picture(tmp_path: Path, layout: str, axis: int) -> None:
    for i in range(3):
        both = np.concatenate([plain(i), plain(100 + i)], axis)
        cv2.imwrite(str(tmp_path / f'{i}.png'), both)
    assert values(open_pictures(tmp_path, layout=layout)) == [(0, 100), (1, 101), (2, 102)]


def test_a_video_of_both_views(tmp_path: Path) -> None:
    path = tmp_path / 'both.avi'
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*'MJPG'), 10.0, (64, 32))
    if not video.isOpened():
        pytest.skip('this OpenCV writes no video')
    for i in range(20):
        both = np.concatenate([plain(5 * i, (32, 32)), plain(255 - 5 * i, (32, 32))], 1)
        video.write(cv2.cvtColor(both, cv2.COLOR_GRAY2BGR))
    video.release()
    pictures = open_pictures(path, interval=0.5, layout='side-by-side')
    expected = [(25 * i, 255 - 25 * i) for i in range(4)]
    np.testing.assert_allclose(values(pictures), expected, atol=3)
    with pytest.raises(CalibrationError, match='--layout'):
        open_pictures(path, interval=0.5)


def test_the_archive_of_ros_calibrator(tmp_path: Path) -> None:
    for i in range(2):
        save(tmp_path / 'in' / f'left-{i:04d}.png', i)
        save(tmp_path / 'in' / f'right-{i:04d}.png', 100 + i)
    (tmp_path / 'in' / 'ost.yaml').write_text('a: 1\n')
    archive = tmp_path / 'calibrationdata.tar.gz'
    with tarfile.open(archive, 'w:gz') as tar:
        for path in sorted((tmp_path / 'in').iterdir()):
            tar.add(path, path.name)
    assert values(open_pictures(archive)) == [(0, 100), (1, 101)]
    archive.write_bytes(archive.read_bytes()[:80])
    with pytest.raises(CalibrationError, match='cannot be unpacked'):
        open_pictures(archive)


@pytest.mark.parametrize(
    'text',
    [
        '"a b.png" c.png\n',
        'a b.png\tc.png\n',
        'a b.png, c.png\n',
        'a b.png c.png\n',
        '%YAML:1.0\n---\nimages:\n   - "a b.png"\n   - c.png\n',
        '%YAML:1.0\n---\nimages: [ "a b.png", "c.png" ]\n',
    ],
)
def test_lists_with_blanks_and_of_opencv(tmp_path: Path, text: str) -> None:
    save(tmp_path / 'a b.png', 1)
    save(tmp_path / 'c.png', 2)
    (tmp_path / 'list.txt').write_text(text)
    assert values(open_pictures(tmp_path / 'list.txt')) == [(1, 2)]


def board_picture(board: Board, turn: int = 0) -> np.ndarray:
    ink, _ = board.print(20)
    picture = cv2.copyMakeBorder(
        (255 * (1 - ink)).astype(np.uint8), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255
    )
    return cv2.GaussianBlur(np.rot90(picture, turn).copy(), (0, 0), 0.7)


def test_a_bad_file_costs_its_pair_and_is_told(tmp_path: Path) -> None:
    board = Board('chessboard', 5, 4, 0.02)
    picture = board_picture(board)
    for i in range(6):
        for side in ('left', 'right'):
            cv2.imwrite(str(tmp_path / f'{side}{i}.jpg'), picture)
    (tmp_path / '._left1.jpg').write_bytes(b'\0\5\26\7')
    (tmp_path / 'left1.jpg').write_bytes(b'')
    (tmp_path / 'right2.jpg').write_bytes(b'no picture')
    cv2.imwrite(str(tmp_path / 'left3.jpg'), picture[:-10])
    cv2.imwrite(str(tmp_path / 'left4.png'), picture)
    pictures = open_pictures(tmp_path)
    (collided,) = pictures.unmatched
    assert 'left4.png: left4.jpg has the same number' in str(collided)
    found = find_boards(pictures.pairs, board)
    assert [pair.name for pair in found.pairs] == [f'left{i}.jpg|right{i}.jpg' for i in (0, 4, 5)]
    assert all(pair.complete for pair in found.pairs)
    told = [str(each) for each in found.dropped]
    assert len(told) == 3
    assert any('left1.jpg is missing or no picture' in each for each in told)
    assert any('the left picture is' in each for each in told)
    for path in tmp_path.glob('left*'):
        path.write_bytes(b'')
    with pytest.raises(CalibrationError, match='no pair of pictures can be read'):
        find_boards(open_pictures(tmp_path).pairs, board)


def test_a_picture_is_taken_as_its_sensor_wrote_it(tmp_path: Path) -> None:
    """EXIF orientation 3 (turned by 180 degrees) is not obeyed, as the nodes do not."""
    picture = plain(30, (48, 64))
    picture[:10, :10] = 220
    jpeg = cv2.imencode('.jpg', picture)[1].tobytes()
    tiff = b'II*\0\x08\0\0\0' + b'\x01\0' + b'\x12\x01\x03\0\x01\0\0\0\x03\0\0\0' + b'\0\0\0\0'
    body = b'Exif\0\0' + tiff
    turned = jpeg[:2] + b'\xff\xe1' + (len(body) + 2).to_bytes(2, 'big') + body + jpeg[2:]
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), 0)[-1, -1] > 150, 'EXIF is not there'
    for side in ('left', 'right'):
        (tmp_path / f'{side}1.jpg').write_bytes(turned)
    assert values(open_pictures(tmp_path))[0][0] > 200
    bag = tmp_path / 'bag'
    with BagWriter(bag) as writer:
        for side in ('left', 'right'):
            topic = f'/stereo/{side}/image_raw/compressed'
            writer.add_topic(topic, messages.COMPRESSED_IMAGE)
            writer.write(topic, 1, messages.compressed_image(10**9, side, turned, 'jpeg'))
    assert values(open_pictures(bag))[0][0] > 200


@pytest.mark.parametrize('big_endian', [False, True])
def test_deep_pictures_show_what_their_bits_hold(big_endian: bool) -> None:
    """12 bits in 16, as machine-vision cameras send them: not black."""
    ramp = np.tile(np.linspace(0, 4095, 64).astype('>u2' if big_endian else '<u2'), (8, 1))
    image = RawImage(ramp.tobytes(), 64, 8, 128, 'mono16', big_endian)
    grey = grey_picture(image, 0)
    np.testing.assert_allclose(grey[0], np.linspace(0, 255, 64), atol=1.0)


def test_stamps_that_are_all_zero_are_told(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        for side in ('left', 'right'):
            writer.add_topic(f'/stereo/{side}/image_raw', messages.IMAGE)
        for i in range(4):
            for side in ('left', 'right'):
                message = messages.image(0, side, plain(i).ravel(), (32, 24), 'mono8', 32)
                writer.write(f'/stereo/{side}/image_raw', 1 + i, message)
    with pytest.raises(CalibrationError, match='stamps of all pictures are 0'):
        open_pictures(tmp_path / 'bag')


@pytest.mark.parametrize('size', [6, 7])
@pytest.mark.parametrize('turn', range(4))
def test_square_boards_are_numbered_alike_in_both_pictures(size: int, turn: int) -> None:
    """Whatever of its four corners the search begins at, left and right begin at the same."""
    board = Board('chessboard', size, size, 0.02)
    picture = board_picture(board)
    view = find_board(picture, board)
    assert view is not None
    grid = view.pixels.reshape(size, size, 2)
    other = BoardView(view.indices, np.rot90(grid, turn).reshape(-1, 2), view.sharpness)
    same = upright_like(other, view, board)
    np.testing.assert_array_equal(same.pixels, view.pixels)
    # An odd number of corners has but two ways to begin at a dark square.
    again = find_board(np.rot90(picture, turn).copy(), board)
    assert again is not None
    first = again.pixels.reshape(size, size, 2)
    middle = first[:2, :2].mean(axis=(0, 1))
    assert size % 2 == 0 or np.rot90(picture, turn)[tuple(np.rint(middle[::-1]).astype(int))] < 99


def test_large_dots_keep_their_centres() -> None:
    """Dots that nearly touch: no part of a neighbour is weighed in (asymmetric circles)."""
    board = Board('asymmetric-circles', 4, 7, 0.02)
    texels, radius = 40.0, 0.68
    points = (board.points[:, :2] / board.square + 1.0) * texels
    width, height = (points.max(axis=0) + texels).astype(int)
    y, x = np.mgrid[:height, :width].astype(float)
    nearest = np.min([np.hypot(x - u, y - v) for u, v in points], axis=0)
    flat = np.clip(255 * (nearest - radius * texels + 0.5), 0, 255).astype(np.uint8)
    view = np.array([[0.5, 0.05, 60.0], [-0.06, 0.42, 50.0], [3e-4, 2e-4, 1.0]])
    picture = cv2.warpPerspective(flat, view, (320, 260), borderValue=255, flags=cv2.INTER_AREA)
    found = find_board(picture, board)
    assert found is not None
    # The image of a circle is a conic; its centre is where the grey values balance.
    back = np.linalg.inv(view)
    expected = []
    for u, v in points:
        circle = np.array(
            [[1, 0, -u], [0, 1, -v], [-u, -v, u * u + v * v - (radius * texels) ** 2]]
        )
        conic = back.T @ circle @ back
        expected.append(np.linalg.solve(conic[:2, :2], -conic[:2, 2]))
    pixels = found.pixels
    errors = [np.abs(each - expected).max() for each in (pixels, pixels[::-1])]
    assert min(errors) < 0.12
