from .frames import Picture

def decode_part(
    data: Picture, pixels: Picture, size: tuple[int, int], box: tuple[int, int, int, int]
) -> None: ...
