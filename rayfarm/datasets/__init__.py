"""Data sets: many views of one scene, as pictures with exact annotation.

cameras.py      poses and intrinsics, from arrays, an orbit, COLMAP or transforms.json
request.py      the arguments of dataset(), checked
annotate.py     the annotation of one view: planes, boxes and masks
pictures.py     the rendered views, from this process or a farm
folder.py       the folder: its description, its manifest and its files
sinks.py        other forms of a finished folder: COCO, transforms.json, WebDataset
hdf5.py         the same: HDF5 files as BlenderProc writes them
bop.py          the same: BOP's folders
parquet.py      the same: the manifest as Parquet
create.py       dataset()
document.py     dataset() from a YAML file
"""
