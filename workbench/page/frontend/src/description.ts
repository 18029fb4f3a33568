/** What the server says besides images; the same names as in workbench/page/description.py. */

export interface WallPart {
  radius_mm: number;
  top_mm: number;
  bottom_mm: number;
}

export interface ClassPart {
  label: string;
  colour: string;
}

export interface LayerPart {
  key: string;
  title: string;
  side: string | null;
  kind: "scalar" | "classes";
  quantity: string;
  unit: string;
  low: number;
  high: number;
  shown_low: number;
  shown_high: number;
  classes: ClassPart[];
  finest_level: number;
  row_mm: number;
  column_mm: number;
}

export interface OutlinePart {
  layer: string;
  side: string;
  title: string;
  colour: string;
  is_drawn: boolean;
}

export type CellState = "matched" | "overlapping" | "alone" | "not observed" | "not aligned";

export interface CellPart {
  side: string;
  id: number;
  theta_rad: number;
  z_mm: number;
  area_mm2: number;
  diameter_mm: number;
  depth_median_mm: number | null;
  depth_p95_mm: number | null;
  volume_mm3: number | null;
  depth_of: string | null;
  contrast: number | null;
  touches_edge: boolean;
  observed_by_other: number;
  covered: number | null;
  seen_by: string;
  partner: number | null;
  overlap: number;
  depth_error_mm: number | null;
  own_depth_mm: number | null;
  own_depth_error_mm: number | null;
  state: CellState;
  why: string;
  is_real: boolean | null;
}

export interface SeriesPart {
  name: string;
  title: string;
  unit: string;
  usual: [number | null, number | null] | null;
  is_flag: boolean;
  values: (number | null)[];
}

export interface BendPart {
  z_mm: number[];
  shift_mm: number[];
  roll_rad: number[];
}

export interface PlacementPart {
  theta_shift_rad: number;
  mirrored: boolean;
  z_shift_mm: number;
  z_scale: number;
  z_reversed: boolean;
  bend: BendPart | null;
}

export interface FramesPart {
  side: string;
  frame_dim: string;
  z_mm: number[];
  pictured: number[];
  recording: string;
  placement: PlacementPart;
  quality: SeriesPart[];
}

export interface Description {
  title: string;
  verdict: string;
  endoct: string;
  sides: string[];
  wall: WallPart;
  layers: LayerPart[];
  outlines: OutlinePart[];
  cells: CellPart[];
  frames: FramesPart[];
  panes: string[];
  has_common_places: boolean;
  has_volume: boolean;
}
