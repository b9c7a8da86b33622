"""Inputs that are still answered wrongly, and why; each must fail, or it has to go from here."""

_BAGS = "reading of bags: cells that are no message, views, jumps of the clock, long paths"
_TABLES = "reading of tables: not finite or not real numbers, damage, stamps beyond those of ROS"
_CONFIGURATION = "reading of the configuration: depth, numbers of thousands of digits, devices"
_URDF = "reading of the URDF: what urdfdom prints, and robots that cannot be"
_RESULTS = "places of results: what exists or cannot be written is found out too late"

_NAMES: dict[str, str] = {
    _BAGS: """
        content-hole-of-a-day content-one-infinite-position content-simulated-then-epoch
        db3-data- db3-data--1 db3-data-1.5 db3-data-92233720 db3-data-NULL db3-data-text
        db3-generated-column db3-recursive-topics db3-recursive-view db3-timestamp-
        db3-timestamp-NULL db3-timestamp-text db3-timestamp-x'00 db3-timestamp-zeroblob
        metadata-nested name-long name-very-long
    """,
    _TABLES: """
        file-mat-empty file-table-empty import-rate-1e-300 import-rate-1e-9
        import-rate-1e12 import-rate-1e300 import-surrogate-joint table-all-nan
        table-booleans table-claims-1e12.npy table-complex table-complex-of-reals
        table-csv-blank-lines table-csv-header-alone table-csv-infinite table-csv-nan
        table-csv-one-long-line table-csv-overflow table-csv-same-header table-csv-zeros
        table-dates table-flipped-0 table-flipped-3 table-flipped-4 table-flipped-5
        table-huge table-infinite table-long-doubles table-mat-complex table-nan
        table-nothing.csv table-nothing.mat table-npy-key-of-vector
        table-npy-key-out-of-range table-zip-start.npz time-below-a-nanosecond
        time-beyond-ros time-complex time-huge time-milliseconds-since-1970
        time-nanoseconds-since-1970 time-negative time-tiny
    """,
    _CONFIGURATION: """
        file-config-endless-noise file-config-endless-zeros file-config-fifo
        file-config-full key-controller.period-too-many-digits
        key-processing.decimation_cutoff-too-many-digits
        key-processing.minimum_speed-too-many-digits
        key-processing.position_cutoff-too-many-digits key-robot.joints-too-many-digits
        key-signals.reference-too-many-digits key-simulator-too-many-digits yaml-braces
        yaml-brackets yaml-dashes yaml-nested-blocks yaml-questions
    """,
    _URDF: """
        file-urdf-link-to-itself urdf-broken-inequality urdf-comma-decimals
        urdf-empty-link-name urdf-huge-origin urdf-indefinite-inertia urdf-infinite-mass
        urdf-joint-named-as-link urdf-limits-infinite urdf-limits-nan urdf-limits-swapped
        urdf-lines-lost-0 urdf-lines-lost-1 urdf-long-axis urdf-long-origin
        urdf-missing-child urdf-missing-parent urdf-nan-axis urdf-nan-damping
        urdf-nan-inertia urdf-nan-mass urdf-nan-origin urdf-nan-rpy urdf-negative-inertia
        urdf-negative-mass urdf-no-limits urdf-no-mass urdf-no-parent urdf-own-parent
        urdf-random-0 urdf-random-1 urdf-random-10 urdf-random-12 urdf-random-14
        urdf-random-15 urdf-random-16 urdf-random-17 urdf-random-18 urdf-random-19
        urdf-random-2 urdf-random-3 urdf-random-4 urdf-random-7 urdf-random-8
        urdf-same-link-twice urdf-short-axis urdf-text-mass urdf-tiny-axis
        urdf-two-parents urdf-two-roots urdf-xacro urdf-zero-axis
    """,
    _RESULTS: """
        out-bag-of-245-bytes out-config-is-the-bag out-import-of-245-bytes out-long-bag
        out-long-import out-no-name out-second-seed-is-a-folder out-truth-is-a-folder
    """,
}

KNOWN = {name: reason for reason, names in _NAMES.items() for name in names.split()}
