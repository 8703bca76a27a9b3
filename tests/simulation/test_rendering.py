from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, distort, image_plane, project_points
from photogram.errors import ImageError
from photogram.simulation.cover.leaves import REST, Cover, CoverPlan, Grower, Leaves, Plants
from photogram.simulation.covered_site import make_covered_scene
from photogram.simulation.rendering import intersect, render, visible
from photogram.simulation.scene import Material, Scene, make_scene, paint_targets

DOWN = np.diag([1.0, -1.0, -1.0])


def camera(width: int = 480, height: int = 320, focal: float = 700.0) -> Camera:
    return Camera(
        "c", width, height, focal, np.array([width / 2 + 2.0, height / 2 - 3.0]), np.array([-0.08, 0.06, -0.01, 0.0]),
        np.array([4e-4, -3e-4]),
    )  # fmt: skip


def pose(degrees: tuple[float, float, float], position: tuple[float, float, float]) -> Pose:
    return Pose(DOWN @ Rotation.from_euler("xyz", degrees, degrees=True).as_matrix(), np.array(position))


def wall_scene() -> Scene:
    """A plane at height 1 of 60 m by 40 m with a wall, 10 m high and 0.5 m thick, along x = 5 for y from −10 to 10."""
    height = np.full((401, 601), 1.0, np.float32)
    x, y = np.meshgrid(np.linspace(-30, 30, 601), np.linspace(-20, 20, 401))
    wall = (np.abs(x - 5.0) < 0.26) & (np.abs(y) < 10.01)
    height[wall] = 11.0
    material = np.where(wall, Material.ROOF_GRAVEL, Material.MEADOW).astype(np.uint8)
    light = np.full(height.shape, 255, np.uint8)
    sun = np.array([0.0, -0.6, 0.8])
    return Scene(height, material, light, -30.0, -20.0, 0.1, np.zeros((0, 2)), 0.0, 0.1, sun, 3)


@pytest.fixture(scope="module")
def scene() -> Scene:
    bare = make_scene(11, 70.0, 0.1, relief_m=6.0, buildings=6, trees=20, finest_wavelength_m=0.12)
    xy = np.random.default_rng(4).uniform(-11.0, 11.0, (300, 2))
    xy = xy[bare.open_ground(xy, 1.5)]
    chosen = [xy[0]]
    for place in xy:
        if np.linalg.norm(place - np.array(chosen), axis=1).min() > 6.0:
            chosen.append(place)
    return paint_targets(bare, np.array(chosen), 0.45)


def test_photograph_has_the_shape_and_the_contrast_asked_for(scene: Scene) -> None:
    picture = render(scene, camera(), pose((1.0, -2.0, 30.0), (0.0, 0.0, 45.0)), seed=1)
    assert picture.shape == (320, 480, 3)
    assert picture.dtype == np.uint8
    tiles = picture[..., 1].reshape(8, 40, 8, 60).std(axis=(1, 3))
    assert tiles.min() > 6.0
    assert np.mean((picture == 0) | (picture == 255)) < 0.01


def test_intersection_with_a_plane_is_exact() -> None:
    flat = replace(wall_scene(), height_m=np.full((401, 601), 1.0, np.float32))
    where, pixel = pose((20.0, 10.0, 70.0), (3.0, -4.0, 25.0)), np.random.default_rng(0).uniform(0, 320, (500, 2))
    ray = np.column_stack([image_plane(camera(), pixel), np.ones(500)]) @ where.rotation_world_from_camera.T
    expected = where.position_world_m + ((1.0 - 25.0) / ray[:, 2:]) * ray
    np.testing.assert_allclose(intersect(flat, camera(), where, pixel), expected, atol=1e-9)


@pytest.mark.parametrize("tilt", [(2.0, -3.0, 10.0), (0.0, 0.0, 180.0), (40.0, 15.0, 60.0)])
def test_project_undoes_intersect_and_the_hit_is_on_the_surface(scene: Scene, tilt: tuple[float, float, float]) -> None:
    where = pose(tilt, (2.0, 1.0, 40.0))
    pixel = np.random.default_rng(1).uniform([0, 0], [479, 319], (3000, 2))
    hit = intersect(scene, camera(), where, pixel)
    assert np.isfinite(hit).all()
    np.testing.assert_allclose(project_points(camera(), where, hit), pixel, atol=1e-8)
    np.testing.assert_allclose(scene.height(hit[:, :2]), hit[:, 2], atol=1e-9)
    assert visible(scene, where, hit).all()


def test_intersection_is_the_first_one(scene: Scene) -> None:
    where = pose((50.0, 0.0, 20.0), (0.0, -5.0, 14.0))
    pixel = np.random.default_rng(2).uniform([0, 0], [479, 319], (300, 2))
    hit = intersect(scene, camera(), where, pixel)
    hit = hit[np.isfinite(hit).all(axis=1)]
    assert len(hit) > 100
    fraction = np.linspace(0.0, 0.999, 4000)[:, None, None]
    path = where.position_world_m + fraction * (hit - where.position_world_m)
    gap = path[..., 2].ravel() - scene.height(path[..., :2].reshape(-1, 2))
    assert gap.min() > -1e-9


def test_rays_that_meet_nothing_see_the_sky(scene: Scene) -> None:
    up = Pose(np.eye(3), np.array([0.0, 0.0, 30.0]))
    assert np.isnan(intersect(scene, camera(), up, np.array([[100.0, 100.0]]))).all()
    sky = render(scene, camera(40, 30), up, seed=0, noise_dn=0.0)
    assert np.ptp(sky.astype(int), axis=(0, 1)).max() <= 1
    assert sky[0, 0, 2] > sky[0, 0, 0]


def test_wall_hides_what_lies_behind_it() -> None:
    scene, where = wall_scene(), pose((0.0, 0.0, 0.0), (-15.0, 0.0, 16.0))
    # The line over the wall's top edge (5.25, 11) meets the ground at x = −15 + 20.25 · 15 / 5 ≈ 46 m, off the plane.
    points = np.array([[8.0, 0.0, 1.0], [20.0, 5.0, 1.0], [2.0, 0.0, 1.0], [20.0, 19.0, 1.0], [5.0, 0.0, 11.0]])
    assert visible(scene, where, points).tolist() == [False, False, True, True, True]
    high = replace(where, position_world_m=np.array([-15.0, 0.0, 60.0]))
    edge = 5.25 + 10.0 * (5.25 + 15.0) / (60.0 - 11.0)
    assert visible(scene, high, np.array([[edge - 0.2, 0.0, 1.0], [edge + 0.2, 0.0, 1.0]])).tolist() == [False, True]
    assert visible(scene, where, np.array([[8.0, 0.0, 14.0]])).all()


def test_target_is_where_the_projection_says(scene: Scene) -> None:
    where = pose((3.0, -2.0, 25.0), (0.5, -0.5, 40.0))
    picture = render(scene, camera(), where, seed=3, noise_dn=0.0).astype(float).mean(axis=2)
    centre = project_points(camera(), where, scene.targets_world_m)
    inside = np.all((centre > 15) & (centre < [464, 304]), axis=1) & visible(scene, where, scene.targets_world_m)
    assert inside.sum() >= 4
    v, u = np.mgrid[0:320, 0:480]
    for x, y in centre[inside]:
        # The dark quarters end within the ring, so that the edge of the window plays no part.
        distance = np.hypot(u - x, v - y)
        ring = np.median(picture[(distance > 9.0) & (distance < 10.0)])
        dark = np.where(distance < 9.5, np.clip(0.7 * ring - picture, 0.0, None), 0.0)
        assert np.hypot((dark * u).sum() / dark.sum() - x, (dark * v).sum() / dark.sum() - y) < 0.1


def test_distortion_is_drawn_as_opencv_removes_it(scene: Scene) -> None:
    where, real = pose((1.0, 2.0, 15.0), (1.0, 0.0, 45.0)), camera()
    strong = replace(real, radial=np.array([-0.25, 0.1, 0.02, 0.0]))
    pinhole = replace(real, radial=np.zeros(4), tangential=np.zeros(2))
    straight = render(scene, pinhole, where, seed=0, noise_dn=0.0, vignetting=0.0)
    bent = render(scene, strong, where, seed=0, noise_dn=0.0, vignetting=0.0)
    u, v = np.meshgrid(np.arange(480.0), np.arange(320.0))
    source = distort(strong, np.column_stack([u.ravel(), v.ravel()])).reshape(320, 480, 2).astype(np.float32)
    undone = cv2.remap(bent, source[..., 0], source[..., 1], cv2.INTER_CUBIC)
    inside = np.all((source > 3) & (source < [476, 316]), axis=2)
    a, b = straight[inside].astype(float).ravel(), undone[inside].astype(float).ravel()
    assert np.corrcoef(a, b)[0, 1] > 0.97
    assert np.corrcoef(a, bent[inside].astype(float).ravel())[0, 1] < 0.9


def test_noise_has_the_level_stated(scene: Scene) -> None:
    where = pose((0.0, 0.0, 0.0), (0.0, 0.0, 45.0))
    a, b = (render(scene, camera(), where, seed=seed, noise_dn=3.0).astype(float) for seed in (1, 2))
    middle = (a > 20) & (a < 235)
    assert (a - b)[middle].std() / np.sqrt(2) == pytest.approx(3.0, rel=0.02)
    assert abs((a - b)[middle].mean()) < 0.05


def test_number_of_threads_changes_nothing(scene: Scene) -> None:
    where = pose((3.0, 2.0, 60.0), (0.0, 0.0, 45.0))
    one = render(scene, camera(203, 117), where, seed=9, threads=1)
    assert one.shape == (117, 203, 3)
    assert np.array_equal(one, render(scene, camera(203, 117), where, seed=9, threads=5))
    assert not np.array_equal(one, render(scene, camera(203, 117), where, seed=10, threads=1))


def test_distortion_that_cannot_be_undone_is_refused(scene: Scene) -> None:
    folded = replace(camera(focal=200.0), radial=np.array([-0.9, 0.0, 0.0, 0.0]))
    with pytest.raises(ImageError, match="cannot be undone"):
        render(scene, folded, pose((0.0, 0.0, 0.0), (0.0, 0.0, 45.0)), seed=0)


@pytest.mark.parametrize("heading", [2.0, 180.0])
def test_photographs_match_where_the_truth_says(scene: Scene, heading: float) -> None:
    first, second = pose((1.0, 0.0, 0.0), (-3.0, 0.0, 42.0)), pose((-1.0, 1.0, heading), (3.0, 1.0, 42.5))
    c = camera(600, 450, 800.0)
    sift = cv2.SIFT_create(enable_precise_upscale=True)  # type: ignore[attr-defined]
    found = [
        sift.detectAndCompute(cv2.cvtColor(render(scene, c, where, seed=n), cv2.COLOR_RGB2GRAY), None)
        for n, where in enumerate((first, second))
    ]
    pairs = cv2.BFMatcher().knnMatch(found[0][1], found[1][1], k=2)
    good = [p for p, q in pairs if p.distance < 0.75 * q.distance]
    a = np.array([found[0][0][m.queryIdx].pt for m in good])
    b = np.array([found[1][0][m.trainIdx].pt for m in good])
    error = project_points(c, second, intersect(scene, c, first, a)) - b
    distance = np.linalg.norm(error, axis=1)
    assert len(good) > 300
    assert np.mean(distance < 2.0) > 0.9
    assert np.median(distance) < 0.3
    assert np.abs(error[distance < 2.0].mean(axis=0)).max() < 0.05


def flat_scene(material: Material, cover: Cover | None) -> Scene:
    """A plane at height 1 of one material, smooth but for its finest texture."""
    plane = wall_scene()
    return replace(
        plane,
        height_m=np.full(plane.height_m.shape, 1.0, np.float32),
        material=np.full(plane.height_m.shape, material, np.uint8),
        cover=cover,
    )


def no_cover() -> Cover:
    return Grower(CoverPlan(), 3).cover(np.array([0.0, -0.6, 0.8]))


def one_leaf(centre: tuple[float, float, float], radius_m: float, sway_m: float) -> Cover:
    """A white disc, level, on a plant of its own."""
    none = no_cover()
    leaves = Leaves(
        np.array([centre]), np.array([[0.0, 0.0, 1.0]]), np.array([radius_m]), np.array([[1.0, 1.0, 1.0]]),
        np.zeros(1, np.int64), np.zeros(1, np.int64),
    )  # fmt: skip
    return replace(none, leaves=leaves, plants=Plants(*(np.array([v]) for v in (0, 1.0, centre[2] - 1.0, sway_m))))


def test_a_scene_whose_cover_is_empty_is_rendered_byte_for_byte_as_one_without(scene: Scene) -> None:
    where = replace(pose((3.0, 2.0, 60.0), (1.0, 0.0, 45.0)), velocity_world_m_s=np.array([8.0, -4.0, 0.0]))
    rolling = replace(camera(), readout_s=0.05)
    plain = render(scene, rolling, where, seed=9)
    empty = replace(scene, cover=no_cover())
    for exposure in (REST, 4):
        assert np.array_equal(plain, render(empty, rolling, where, seed=9, exposure=exposure))
    pixel = np.random.default_rng(1).uniform([0, 0], [479, 319], (500, 2))
    assert np.array_equal(intersect(scene, camera(), where, pixel), intersect(empty, camera(), where, pixel))


@pytest.mark.parametrize("exposure", [REST, 0, 1, 7])
def test_a_leaf_is_where_the_projection_says_in_both_photographs(exposure: int) -> None:
    cover = one_leaf((1.0, -2.0, 9.0), 0.4, 0.2)
    scene, moved = flat_scene(Material.TREE, cover), cover.sway_m(exposure)[0]
    assert (np.linalg.norm(moved) > 0.005) == (exposure != REST)
    place = cover.leaves.centre_m + moved
    centres = []
    for position in ((-4.0, 0.0, 40.0), (5.0, -3.0, 42.0)):
        where = pose((2.0, -3.0, 25.0), position)
        picture = render(scene, camera(), where, seed=1, noise_dn=0.0, vignetting=0.0, exposure=exposure)
        weight = np.clip(picture.astype(float).mean(axis=2) - 200.0, 0.0, None)
        v, u = np.mgrid[0:320, 0:480]
        centres.append(np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum())
        np.testing.assert_allclose(centres[-1], project_points(camera(), where, place)[0], atol=0.15)
        hit = intersect(scene, camera(), where, project_points(camera(), where, place), exposure=exposure)
        np.testing.assert_allclose(hit, place, atol=1e-9)
        assert visible(scene, where, cover.leaves.centre_m).all()
        foot = where.position_world_m + (cover.leaves.centre_m - where.position_world_m) * (
            (where.position_world_m[2] - 1.0) / (where.position_world_m[2] - 9.0)
        )
        assert not visible(scene, where, foot).any()
    assert np.linalg.norm(centres[0] - centres[1]) > 100.0


def test_water_differs_between_exposures_and_the_ground_does_not() -> None:
    where = pose((0.0, 0.0, 0.0), (0.0, 0.0, 40.0))

    def pictures(material: Material) -> list[np.ndarray]:
        scene = flat_scene(material, no_cover())
        return [
            render(scene, camera(), where, seed=0, noise_dn=0.0, exposure=n).astype(float)[..., 1] for n in range(3)
        ]

    road, water, grass = pictures(Material.ROAD), pictures(Material.WATER), pictures(Material.GRASS)
    assert np.array_equal(road[0], road[1])
    for a, b in ((0, 1), (1, 2)):
        texture = [w - cv2.GaussianBlur(w, (0, 0), 20.0) for w in (water[a], water[b])]
        assert abs(np.corrcoef(texture[0].ravel(), texture[1].ravel())[0, 1]) < 0.1
        assert 0.0 < np.abs(grass[a] - grass[b]).mean() < np.abs(grass[a] - np.roll(grass[b], 9, axis=0)).mean()
    # blades move by less than a pixel: a photograph of grass still looks like the other
    assert np.corrcoef(grass[0].ravel(), grass[1].ravel())[0, 1] > 0.7
    assert water[0].std() > 1.0


def test_water_glitters_towards_the_sun() -> None:
    """The sun stands in the south, 53° high: the water's mirror image of it is seen looking north by 37°."""
    scene = flat_scene(Material.WATER, no_cover())
    towards, away = (
        render(scene, camera(), pose((tilt, 0.0, 0.0), (0.0, 0.0, 12.0)), seed=0, noise_dn=0.0, exposure=2)
        for tilt in (37.0, -37.0)
    )
    glints = [float(np.mean(picture.min(axis=2) > 200)) for picture in (towards, away)]
    assert max(glints) > 0.01
    assert min(glints) < 0.1 * max(glints)


def test_a_thin_wire_dims_the_pixels_it_crosses_by_its_width() -> None:
    grower = Grower(CoverPlan(), 3)
    grower.line(np.array([[-8.0, 0.0, 9.0], [8.0, 0.0, 9.0]]), 0.01, (0.0, 0.0, 0.0))
    scene = flat_scene(Material.PAINT, grower.cover(np.array([0.0, -0.6, 0.8])))
    where = pose((0.0, 0.0, 0.0), (0.0, 0.0, 41.0))
    with_wire, without = (
        (render(s, camera(), where, seed=0, noise_dn=0.0, vignetting=0.0, blur_px=0.0).astype(float) / 255.0) ** 2
        for s in (scene, replace(scene, cover=no_cover()))
    )
    lost = (without - with_wire)[:, 200:280, 1] / without[:, 200:280, 1]
    assert lost.sum(axis=0).mean() == pytest.approx(0.02 / (32.0 / 700.0), rel=0.1)
    assert np.count_nonzero(lost.mean(axis=1) > 0.01) <= 2


@pytest.fixture(scope="module", name="covered")
def _covered() -> Scene:
    plan = CoverPlan(hedges=2, fences=1, wood_trees=8, pond_radius_m=5.0)
    return make_covered_scene(5, 70.0, 0.2, 5.0, 2, 20, finest_wavelength_m=0.15, plan=plan)


def test_with_cover_threads_change_nothing_and_exposures_do(covered: Scene) -> None:
    where = pose((3.0, 2.0, 60.0), (0.0, 0.0, 45.0))
    one = render(covered, camera(203, 117, 300.0), where, seed=9, threads=1, exposure=3)
    assert np.array_equal(one, render(covered, camera(203, 117, 300.0), where, seed=9, threads=5, exposure=3))
    assert not np.array_equal(one, render(covered, camera(203, 117, 300.0), where, seed=9, threads=1, exposure=4))


def test_with_cover_the_hit_is_seen_and_on_the_surface(covered: Scene) -> None:
    where = pose((10.0, 5.0, 20.0), (0.0, 0.0, 45.0))
    pixel = np.random.default_rng(1).uniform([0, 0], [479, 319], (4000, 2))
    hit = intersect(covered, camera(focal=400.0), where, pixel)
    np.testing.assert_allclose(project_points(camera(focal=400.0), where, hit), pixel, atol=1e-7)
    assert visible(covered, where, hit).all()
    above = hit[:, 2] - covered.height(hit[:, :2])
    assert above.min() > -1e-9
    assert 0.02 < np.mean(above > 0.1) < 0.6
