"""Reads exported data sets with libraries of others; runs in .venv-datasets (scripts/setup.sh --tests), where
their names collide with nothing:

    python outside_datasets.py READER FOLDER OUT.npz

What each reader found goes into OUT.npz, for the tests to compare.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np


def events_of(events):
    """evlib's RawEvents as columns."""
    return {"t_s": events.timestamp, "x": events.x, "y": events.y, "p": events.polarity}


def dsec_loader(folder, side="left", **options):
    """event-vision-library's loader of DSEC, told our size. FOLDER: of a sequence."""
    from evlib.dataloaders import DSECDataLoader

    class OfOurSize(DSECDataLoader):
        EVENT_SHAPE = (72, 96)

    return OfOurSize(str(folder.parent), folder.name, camera=side, **options)


def dsec(folder):
    out = {}
    for side in ("left", "right"):
        loader = dsec_loader(folder, side, event_load_mode="cached")  # which looks at every time and place
        out |= {f"{side}_{k}": v for k, v in events_of(loader.load_events(0, loader.num_events)).items()}
        out |= {f"{side}_window_{k}": v for k, v in events_of(loader.get_events_by_time(0.0205005, 0.0712005)).items()}
        out[f"{side}_map"], out[f"{side}_ms_to_idx"] = loader.rectify_map, loader.ms_to_idx
    loader = dsec_loader(
        folder,
        load_images=True,
        load_flow_forward=True,
        load_flow_backward=True,
        load_disparity=True,
        load_calibration=True,
    )
    out["image_times"], out["exposures"] = loader.image_timestamps, loader.image_exposure_timestamps
    out["images"] = np.stack([loader.load_image(i) for i in range(loader.num_images)])
    for direction in ("forward", "backward"):
        load, count = getattr(loader, f"load_flow_{direction}"), getattr(loader, f"num_flow_{direction}")
        out[direction], out[f"{direction}_known"] = map(np.stack, zip(*map(load, range(count)), strict=True))
        out[f"{direction}_times"] = getattr(loader, f"flow_{direction}_timestamps")
    fields = [loader.load_disparity(i) for i in range(loader.num_disparity_frames)]
    out["disparity"], out["disparity_known"] = map(np.stack, zip(*fields, strict=True))
    out["disparity_times"] = loader.disparity_timestamps
    calibration = loader.calibration
    out["Q"] = np.array(calibration["disparity_to_depth"]["cams_03"])
    for camera in (0, 3):
        out[f"K{camera}"] = np.array(calibration["intrinsics"][f"cam{camera}"]["camera_matrix"])
        out[f"D{camera}"] = np.array(calibration["intrinsics"][f"cam{camera}"]["distortion_coeffs"])
        out[f"Kr{camera}"] = np.array(calibration["intrinsics"][f"camRect{camera}"]["camera_matrix"])
        out[f"R{camera}"] = np.array(calibration["extrinsics"][f"R_rect{camera}"])
    out["T10"], out["T31"] = (np.array(calibration["extrinsics"][name]) for name in ("T_10", "T_31"))
    return out


def ecd(folder):
    """event-vision-library's loader of DAVIS recordings. FOLDER: of a recording."""
    from evlib.dataloaders import DavisRecordingLoader

    with tempfile.TemporaryDirectory() as cache:
        loader = DavisRecordingLoader(
            str(folder), load_imu=True, load_gt_pose=True, cache_dir=cache, event_load_mode="cached"
        )
    out = events_of(loader.load_events(0, loader.num_events))
    out["images"] = np.stack([loader.load_image(i) for i in range(loader.num_images)])
    out["image_times"] = loader.image_timestamps
    out |= {f"imu_{k}": v for k, v in loader.imu_data.items()}
    out |= {f"pose_{k}": v for k, v in loader.gt_pose.items()}
    out["K"], out["D"] = loader.calibration.camera_matrix, loader.calibration.distortion_coefficients
    return out


def evreal(folder):
    """EVREAL's own MemMapDataset: what lies between the pictures. FOLDER: of a recording."""
    from dataset import MemMapDataset

    data = MemMapDataset(str(folder), num_bins=5)
    items = [data[i] for i in range(len(data))]
    out = {name: np.stack([item[name].numpy() for item in items]) for name in ("frame", "events", "frame_timestamp")}
    return out | {"event_count": np.array([item["event_count"] for item in items])}


def radiance(folder):
    """nerfbaselines' loader of transforms.json, and the rays of its cameras through all pixels. FOLDER: of a camera."""
    from nerfbaselines.cameras import get_image_pixels, get_rays
    from nerfbaselines.datasets.nerfstudio import load_nerfstudio_dataset

    found = load_nerfstudio_dataset(folder, "train")  # nine tenths, rounded up: all of a few
    cameras = found["cameras"]
    cameras.distortion_parameters[:, [2, 3]] = cameras.distortion_parameters[:, [3, 2]]  # 1.2.12 exchanges p1 and p2
    pixels = get_image_pixels(cameras.image_sizes[0])  # whole numbers; rays pass through the centres
    rays = [get_rays(cameras[i : i + 1], pixels) for i in range(len(cameras))]
    origins, directions = map(np.stack, zip(*rays, strict=True))
    names = np.array([Path(p).name for p in found["image_paths"]])
    return {"pixels": pixels, "names": names, "origins": origins, "directions": directions}


def webdataset(folder):
    """All samples of FOLDER's train shards, in order."""
    import webdataset as wds

    shards = sorted(str(p) for p in folder.glob("train-*.tar"))
    out, keys = {}, []
    for sample in wds.WebDataset(shards, shardshuffle=False).decode("rgb8"):
        keys.append(sample["__key__"])
        for name in ("events", "causes", "objects", "flow", "depth", "instances", "boxes"):
            out[f"{keys[-1]}/{name}"] = sample[f"{name}.npy"]
        if "frame.png" in sample:
            out[f"{keys[-1]}/frame"] = sample["frame.png"]
        out[f"{keys[-1]}/start_us"] = sample["json"]["start_us"]
    return out | {"keys": np.array(keys), "shards": np.array(shards)}


def ros1(bag):
    """importRosbag's arrays of each topic."""
    from importRosbag.importRosbag import importRosbag

    topics = importRosbag(filePathOrName=str(bag), disable_bar=True)
    return {f"{t}:{name}": v for t, found in topics.items() for name, v in found.items() if isinstance(v, np.ndarray)}


def windows(folder):
    """pecs.datasets.Windows through PyTorch's DataLoader, and under tonic's transforms. FOLDER: of a sequence."""
    import tonic.transforms
    from pecs.datasets import Sequence, Windows, collate
    from torch.utils.data import DataLoader

    fields = ("flow", "depth", "frame", "boxes")
    data = Windows(Sequence(folder), "left", window_us=20_000, fields=fields, voxel_grid={"bins": 5})
    data[0]  # what is open before the workers begin
    out = {name: [] for name in ("torch_items", "torch_n", "torch_t", "torch_flow", "torch_frame", "torch_boxes")}
    out["torch_voxels"] = []
    for number, batch in enumerate(DataLoader(data, 2, num_workers=2, collate_fn=collate)):
        for i in range(len(batch["start_us"])):
            mine = batch["events"][batch["events"][:, 0] == i]
            out["torch_items"].append(number)
            out["torch_n"].append(len(mine))
            out["torch_t"].append(mine[:, 1].sum().item())
            out["torch_flow"].append(batch["flow"][i].numpy())
            out["torch_frame"].append(batch["frame"][i].numpy())
        out["torch_boxes"] += batch["boxes"].tolist()
        out["torch_voxels"] += [*batch["voxel_grid"].numpy()]

    out["torch_late_us"] = collate([data[0] | {"truth_us": 2**26 + 0.5}])["truth_us"].tolist()
    sensor = (96, 72, 2)
    items = [data[i]["events"] for i in range(len(data))]
    frames = tonic.transforms.ToFrame(sensor_size=sensor, n_time_bins=4)
    chained = Windows(data.sequences, "left", window_us=20_000, transform=frames)
    out["tonic_frames"] = [chained[i]["events"] for i in range(len(chained))]
    out["tonic_denoised"] = [len(tonic.transforms.Denoise(5000)(events)) for events in items]
    grid = tonic.transforms.ToVoxelGrid(sensor_size=sensor, n_time_bins=5)
    out["tonic_voxels"] = [grid(events) for events in items]  # it changes them
    return {name: np.array(values) for name, values in out.items()}


if __name__ == "__main__":
    reader, folder, out = sys.argv[1:]
    np.savez(out, **globals()[reader](Path(folder)))
