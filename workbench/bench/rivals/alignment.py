"""How one would align two panoramas with existing libraries, in a few lines each.

Each gets what ours is given, with the light taken off as ours does it. None knows that θ is a circle, so they see A
continued by half a turn at either end. Those that cannot search orientations are tried in all that are open, and the
result that correlates best is kept. Those that need the polarity are tried with both.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from skimage.registration import phase_cross_correlation

from endoct.base.arrays import Coordinates, Image
from endoct.fusion.evidence.evidence import Evidence, clipped, on_grid, prepare, reoriented
from endoct.fusion.geometry.alignment import Alignment, NotAligned, Orientation
from endoct.fusion.registration.align import orientations_of
from endoct.stitching.panorama import Panorama

SLOW_PX = 4
"""Methods that would otherwise take minutes get pixels as large as this many samples of A."""
BLUR_PX = 1.0
MOST_FEATURES = 10_000
"""The strongest of an image: noise has 70 000, and matching those with one another takes minutes for every try."""
Matrix = Coordinates
FEWEST_MATCHES, REPROJECTION_PX = 4, 3.0
BINS = 32


@dataclass(frozen=True)
class Flat:
    """Two flat images of one pixel size: ``a`` continued around by half a turn at either end, ``b`` one turn.

    ``place`` makes an alignment of a matrix (2, 3) that maps (x, y) of B to (x, y) of A, pixels.
    """

    a: Image
    b: Image
    px_mm: float
    starts_mm: tuple[float, float]
    radius_mm: float
    orientation: Orientation

    def place(self, matrix: Coordinates) -> Alignment:
        """Return the turn, shift and scale of an affine matrix; what else is in it is left out."""
        rad = self.px_mm / self.radius_mm
        half, middle = self.b.shape[1] // 2, np.array([self.b.shape[1] / 2, self.b.shape[0] / 2, 1.0])
        x, y = np.asarray(matrix, np.float64) @ middle
        scale = float(matrix[1][1])
        b_mm = self.starts_mm[1] + middle[1] * self.px_mm  # z of B's middle after the orientation
        return Alignment(
            theta_shift_rad=float(np.mod((x - half - middle[0]) * rad, 2 * np.pi)),
            z_shift_mm=float(self.starts_mm[0] + y * self.px_mm - scale * b_mm),
            z_scale=scale,
            mirrored=self.orientation[0],
            z_reversed=self.orientation[1],
        )

    def correlation(self, matrix: Coordinates) -> float:
        """Return the correlation of A with B brought there, without its sign; 0 where they hardly overlap."""
        forward = np.vstack([np.asarray(matrix, np.float64), [0, 0, 1]])
        if not np.isfinite(forward).all() or abs(np.linalg.det(forward)) < 1e-6:
            return 0.0
        size = self.a.shape[1], self.a.shape[0]
        moved = cv2.warpAffine(self.b, forward[:2], size, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
        covered = np.isfinite(moved)
        if covered.sum() < 0.1 * self.b.size:
            return 0.0
        (of_a, both), (_, of_b) = np.cov(self.a[covered], moved[covered])
        return float(abs(both) / np.sqrt(of_a * of_b)) if of_a > 0 and of_b > 0 else 0.0


Method = Callable[[Flat], Iterable[Matrix]]


def phase_correlation(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """scikit-image's phase correlation of A with B, padded, at scale 1."""
    return best_of(a, b, lambda flat: [_phase_shift(flat, 20)])


def _phase_shift(flat: Flat, upsample_factor: int = 1) -> Matrix:
    b_there = np.zeros_like(flat.a)
    rows = min(flat.a.shape[0], flat.b.shape[0])
    b_there[:rows, : flat.b.shape[1]] = flat.b[:rows]
    (down, across), _, _ = phase_cross_correlation(flat.a, b_there, upsample_factor=upsample_factor)
    return np.array([[1, 0, across], [0, 1, down]])


def ecc(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """OpenCV's ECC (affine), started from scikit-image's phase correlation, with either polarity."""
    criteria = cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-5

    def refined(flat: Flat) -> Iterator[Matrix]:
        first, mask = _phase_shift(flat).astype(np.float32), np.full(flat.a.shape, 255, np.uint8)
        for sign in (1, -1):
            with suppress(cv2.error):
                image, start = np.float32(sign) * flat.b, first.copy()
                _, matrix = cv2.findTransformECC(image, flat.a, start, cv2.MOTION_AFFINE, criteria, mask, 5)
                yield np.asarray(matrix, np.float64)

    return best_of(a, b, refined)


def sift_ransac(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """SIFT features, matched by Lowe's ratio, and OpenCV's RANSAC of a partial affine; with either polarity."""
    sift = cv2.SIFT.create(MOST_FEATURES)

    def described(image: Image) -> tuple[Sequence[cv2.KeyPoint], Any]:
        return sift.detectAndCompute((255 * unit(image)).astype(np.uint8), None)

    def matrices(flat: Flat) -> Iterator[Matrix]:
        points_a, described_a = described(flat.a)
        for sign in (1, -1):
            points_b, described_b = described(np.float32(sign) * flat.b)
            if described_a is None or described_b is None or len(points_a) < 2:
                continue
            pairs = cv2.BFMatcher().knnMatch(described_b, described_a, k=2)
            good = [pair[0] for pair in pairs if len(pair) == 2 and pair[0].distance < 0.8 * pair[1].distance]
            if len(good) < FEWEST_MATCHES:
                continue
            from_b, to_a = [points_b[one.queryIdx].pt for one in good], [points_a[one.trainIdx].pt for one in good]
            cv2.setRNGSeed(0)
            matrix, _ = cv2.estimateAffinePartial2D(
                np.array(from_b), np.array(to_a), ransacReprojThreshold=REPROJECTION_PX
            )
            if matrix is not None:
                yield np.asarray(matrix, np.float64)

    return best_of(a, b, matrices)


def mutual_information(a: Panorama, b: Panorama) -> Alignment | NotAligned:
    """SimpleITK's registration by Mattes' mutual information, affine, from the middle, on every fourth sample."""
    import SimpleITK as sitk

    def registered(flat: Flat) -> Iterator[Matrix]:
        fixed, moving = sitk.GetImageFromArray(flat.b), sitk.GetImageFromArray(flat.a)
        middle = sitk.CenteredTransformInitializerFilter.GEOMETRY
        first = sitk.CenteredTransformInitializer(fixed, moving, sitk.AffineTransform(2), middle)
        matrix = descended(flat, first, "RANDOM", 0.2)
        if matrix is not None:
            yield matrix

    with one_itk_thread():
        return best_of(a, b, registered, SLOW_PX)


def by_information() -> Any:
    """Return SimpleITK's registration by Mattes' mutual information."""
    import SimpleITK as sitk

    method = sitk.ImageRegistrationMethod()
    method.SetMetricAsMattesMutualInformation(BINS)
    method.SetInterpolator(sitk.sitkLinear)
    return method


def descended(flat: Flat, first: Any, sampling: str, share: float) -> Matrix | None:
    """Return what SimpleITK's gradient descent makes of an affine transform, of a ``share`` of the samples.

    ``sampling``: "RANDOM" or "REGULAR". None where it gives up.
    """
    import SimpleITK as sitk

    method = by_information()
    method.SetMetricSamplingStrategy(getattr(method, sampling))
    method.SetMetricSamplingPercentage(share, 1)  # the seed
    method.SetOptimizerAsRegularStepGradientDescent(1.0, 1e-4, 200)
    method.SetOptimizerScalesFromPhysicalShift()
    method.SetShrinkFactorsPerLevel([4, 2, 1])
    method.SetSmoothingSigmasPerLevel([2, 1, 0])
    method.SetInitialTransform(first)
    try:
        transform = method.Execute(sitk.GetImageFromArray(flat.b), sitk.GetImageFromArray(flat.a))
    except RuntimeError:
        return None
    corners = (0.0, 0.0), (1.0, 0.0), (0.0, 1.0)
    origin, right, down = (np.array(transform.TransformPoint(corner)) for corner in corners)
    return np.stack([right - origin, down - origin, origin], axis=1)


@contextmanager
def one_itk_thread() -> Iterator[None]:
    """Limit SimpleITK to one thread, so that it adds up in one order on any machine.

    A method's own number of threads would not limit its metric.
    """
    import SimpleITK as sitk

    before = sitk.ProcessObject.GetGlobalDefaultNumberOfThreads()
    sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(1)
    try:
        yield
    finally:
        sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(before)


def best_of(a: Panorama, b: Panorama, method: Method, px: int = 1) -> Alignment | NotAligned:
    """Return the alignment that correlates best of all that ``method`` yields in the orientations that are open."""
    prepared = clipped(prepare(a)), clipped(prepare(b))
    candidates: list[tuple[float, Alignment]] = []
    for orientation in orientations_of(a, b):
        flat = flat_of(*prepared, orientation, px)
        candidates += [(flat.correlation(matrix), flat.place(matrix)) for matrix in method(flat)]
    if not candidates:
        return NotAligned("It found nothing.")
    return max(candidates, key=lambda candidate: candidate[0])[1]


def flat_of(a: Evidence, b: Evidence, orientation: Orientation, px: int) -> Flat:
    """Return both sides flat in one of the orientations, in pixels of ``px`` samples of A, slightly blurred."""
    n_theta = 2 * round(a.values.shape[1] / (2 * px))
    px_mm = 2 * np.pi * a.radius_mm / n_theta
    turned = reoriented(b, mirrored=orientation[0], z_reversed=orientation[1], z_scale=1.0)
    images, starts = [], []
    for side in (a, turned):
        n = 1 + int(np.ptp(side.z_mm) / px_mm)
        even = on_grid(side, side.z_mm[0] + px_mm * np.arange(n), n_theta)
        images.append(np.asarray(cv2.GaussianBlur(even.values, (0, 0), BLUR_PX), dtype=np.float32))
        starts.append(float(side.z_mm[0]))
    around = np.pad(images[0], ((0, 0), (n_theta // 2, n_theta // 2)), mode="wrap").astype(np.float32, copy=False)
    return Flat(around, images[1], px_mm, (starts[0], starts[1]), a.radius_mm, orientation)


def unit(image: Image) -> Image:
    """Return an image brought to [0, 1], the hundredth part at either end clipped, float32."""
    low, high = np.percentile(image, [1, 99])
    return np.asarray(np.clip((image - low) / max(high - low, 1e-6), 0, 1), dtype=np.float32)
