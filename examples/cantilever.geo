// A solid cantilever with an edge crack, mm; `size` and `fine` may be set before. Of second order; the crack's faces are
// one until gmsh's plugin Crack gives the left one nodes of its own, but for the front; it opens at "mouth".
SetFactory("OpenCASCADE");
DefineConstant[ size = 10, fine = 5 ];

Box(1) = {0, 0, 0, 200, 20, 10};
Rectangle(100) = {0, 0, 0, 5, 20};
Rotate {{0, 1, 0}, {0, 0, 0}, -Pi / 2} { Surface{100}; }
Translate {80, 0, 5} { Surface{100}; }
BooleanFragments{ Volume{1}; Delete; }{ Surface{100}; Delete; }

e = 1e-3;
crack() = Surface In BoundingBox{80 - e, -e, 5 - e, 80 + e, 20 + e, 10 + e};
front() = Curve In BoundingBox{80 - e, -e, 5 - e, 80 + e, 20 + e, 5 + e};
mouth() = Curve In BoundingBox{80 - e, -e, 5 - e, 80 + e, 20 + e, 10 + e};
mouth() -= front();
Physical Volume("steel", 1) = Volume{:};
Physical Surface("clamp", 2) = Surface In BoundingBox{-e, -e, -e, e, 20 + e, 10 + e};
Physical Surface("right", 3) = crack();
Physical Curve("mouth", 4) = mouth();
Physical Surface("left", 5) = {};

Field[1] = Distance;
Field[1].CurvesList = {front()};
Field[1].SurfacesList = {crack()};
Field[2] = Threshold;
Field[2].InField = 1;
Field[2].SizeMin = fine;
Field[2].SizeMax = size;
Field[2].DistMin = 1;
Field[2].DistMax = 15;
Background Field = 2;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
Mesh.Algorithm3D = 1;
Mesh.ElementOrder = 2;

// what CalculiX reads: volumes, and the nodes of all groups
Mesh.SaveGroupsOfElements = -1000;
Mesh.SaveGroupsOfNodes = 1;
Mesh 3;
Plugin(Crack).Dimension = 2;
Plugin(Crack).PhysicalGroup = 3;
Plugin(Crack).OpenBoundaryPhysicalGroup = 4;
Plugin(Crack).NewPhysicalGroup = 5;
Plugin(Crack).Run;
