"""Dense matching of epipolar pairs in blocks, each node on its own surface: what the surface model is made of.

How it goes, in one page. Every step has a file, which says why; here is who hands what to whom.

    blocks           a block of a pair: its start surface, what is left of the y-parallax, the nodes, agreement of neighbours
    pair_surface     the same for a pair that has nothing but itself (pair_start: a volume of parallaxes in place of heights)
      epipolar_least_squares    the nodes of a block: planes, one round on coarse nodes, the ladder of windows, what is stated
        node_surfaces           a plane (parallax, slope along, slope across) at every node, fitted to start or neighbours
        surface_warp            the right image seen along all planes at once: from here on windows compare pixel with pixel
        node_runs               windows of one size of up to 64 nodes in a row (a run)
          shared_sums           sums of whole windows, which neighbours share: down the columns once, then along the parts
          window_solution       one window: cut pixel by pixel, or solved from the shared sums; five unknowns, two variances
        joined_nodes            neighbours on one plane, joined

Words that the kernels share, with the same meaning everywhere:

    pair       `WarpedPair`: left image, warped right image, gradient and field, flat, with a margin so wide that no window of any
               size leaves them. `cols` is the length of a row with its margins.
    field      parallax at which the right image was resampled, per pixel: that of the plane of the nearest node.
    centre     flat place of a node in these images: row and column of the left image, plus the margin.
    plane      (3,): parallax of a node and its slopes. A window's support is where the field lies within `surface_tolerance` of it.
    half       half side of a window; a window is whole where all of it is support.
    flat       whether corrections count from the plane of the node rather than from the field. The field is smooth over a normal
               window only: wider ones would find the errors in it that they are there to remove.
    parts      3 x 3 of a window: the scores of nine parts tell a surface that bends from one that is merely noisy.
    sums       (21,): all products that the normal equations of a window need. Both ways to get them end here.
    solution   (10,): what a window says of its node; its places are named in window_solution.
    ladder     what the windows so far say of a run. The normal window is solved first, for it tells the smallest one worth trying;
               it takes its turn when the smaller ones have had theirs. A larger one takes over while it agrees with all smaller.

Who owns memory. `match_nodes` allocates everything: the pair, the planes, one run (`run_for`: its nodes, the block of one window,
the shared sums) and one ladder. Kernels fill what they are given and return numbers: none makes an array, and none counts
references to one (kernel.py says what that saves). Sizes follow from the widest window alone: one run serves windows of all sizes.

Two ways of one thing. `solved` (from the pixels) and `solved_whole` (from shared sums) differ by rounding only; tests compare them
with each other and with plain NumPy. Sharing pays for windows of 9 px and more, where enough of a run is whole (`_share`).

Three places look odd and are meant. Numbers that never change are read from memory (`ramp`, `places`): were they known, the
compiler would test whether arrays overlap, or repeat a kernel for each of them. Indices are unsigned where they cannot be negative:
it spares a test per pixel. And coordinates count from the first pixel of a part in shared sums, from the node everywhere else: a
column belongs to many nodes.
"""
