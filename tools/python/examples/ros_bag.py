"""A bag of a sensor with a message of its own: counts with ids become forces, contacts, a video and images of ROS."""

import sys

import dermatome
import dermatome.ros


def main(table: str, bag: str, topic: str) -> None:
    skin_map = dermatome.build(dermatome.Skin.read(table, unit="mm"))
    counts = dermatome.ros.read(bag, topic, skin_map, values="counts", ids="cells", channels="force")
    forces = counts.condition(skin_map, scale=1 / 350, baseline=20, units="N")
    print(forces, *forces.remarks, sep="\n")
    tracker = dermatome.ContactTracker(skin_map, unit="N", threshold=0.05)
    for seconds, values in zip(forces.timestamps, forces.values[:, 0]):
        for contact in tracker.track(values):
            if contact["event"] == "onset":
                print(f"{seconds:.2f} s: contact {contact['track']} on {contact['patch']}, {contact['force']:.2f} N")
    skin_map.renderer(0, extensive=True, size=(96, 128)).video(forces.values, "touch.gif", rate=25)
    dermatome.ros.write("images", skin_map, forces)
    dermatome.ros.write("fields", skin_map, forces, level=1)


if __name__ == "__main__":
    main(*sys.argv[1:4])
