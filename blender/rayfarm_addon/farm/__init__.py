"""The protocol with a farm: requests, uploads and live channels. Independent of Blender."""
