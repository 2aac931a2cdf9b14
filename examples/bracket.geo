// A bracket bolted to a wall: two bolt holes with bronze bushes, a filleted arm, a crack in the top edge of the arm. Lengths in m.
// What the program that reads it needs are the physical groups at the end: materials, supports, the crack and named points.

h = 0.020;          // cells of the leg and of the arm
fine = 0.007;      // cells along the crack
thick = 0.040;      // height of the arm, width of the leg
reach = 0.160;      // of the arm, from the wall
tall = 0.140;       // of the leg
round = 0.020;      // radius of the fillet
crack = 0.027;      // depth of the crack below the top edge
hole = 0.008;       // radius of the bolt holes
bush = 0.014;       // outer radius of the bushes

// outline, counter-clockwise from the lower left corner
Point(1) = {0, 0, 0, h};
Point(2) = {thick, 0, 0, h};
Point(3) = {thick, tall - thick - round, 0, h};
Point(4) = {thick + round, tall - thick, 0, h};
Point(5) = {reach, tall - thick, 0, h};
Point(6) = {reach, tall, 0, h};
Point(7) = {0.092, tall, 0, fine};                       // mouth of the crack
Point(8) = {0, tall, 0, h};
Point(9) = {thick + round, tall - thick - round, 0, h};  // centre of the fillet
Point(11) = {0.084, tall - thick, 0, 1.4 * fine};        // below the tip of the crack
Line(1) = {1, 2};
Line(2) = {2, 3};
Circle(3) = {3, 9, 4};
Line(4) = {4, 11};
Line(10) = {11, 5};
Line(5) = {5, 6};
Line(6) = {6, 7};
Line(7) = {7, 8};
Line(8) = {8, 1};
Curve Loop(1) = {1:4, 10, 5:8};

// the crack leans by about 17 degrees: its tip is loaded in modes I and II
Point(10) = {0.084, tall - crack, 0, fine};
Line(9) = {7, 10};

// two bushes around the bolt holes: eight congruent pieces each, which the program computes once
surfaces[] = {};
inner[] = {};
outer[] = {};
loops[] = {1};
For k In {0:1}
  x = 0.5 * thick;
  y = 0.024 + 0.056 * k;
  p = newp;
  Point(p) = {x, y, 0, h};
  For i In {0:7}
    Point(p + 1 + i) = {x + hole * Cos(i * Pi / 4), y + hole * Sin(i * Pi / 4), 0, h};
    Point(p + 9 + i) = {x + bush * Cos(i * Pi / 4), y + bush * Sin(i * Pi / 4), 0, h};
  EndFor
  c = newc;
  For i In {0:7}
    j = (i + 1) % 8;
    Circle(c + i) = {p + 1 + i, p, p + 1 + j};
    Circle(c + 8 + i) = {p + 9 + i, p, p + 9 + j};
    Line(c + 16 + i) = {p + 1 + i, p + 9 + i};
  EndFor
  Transfinite Curve{c : c + 23} = 2;
  loop = newcl;
  Curve Loop(loop) = {c + 8 : c + 15};
  loops[] += loop;
  inner[] += {c : c + 7};
  outer[] += {c + 8 : c + 15};
  For i In {0:7}
    s = news;
    piece = newcl;
    Curve Loop(piece) = {c + i, c + 16 + (i + 1) % 8, -(c + 8 + i), -(c + 16 + i)};
    Plane Surface(s) = {piece};
    Transfinite Surface{s};
    surfaces[] += s;
  EndFor
EndFor

Plane Surface(1) = {loops[]};
Curve{9} In Surface{1};
Recombine Surface{1, surfaces[]};
Mesh.Algorithm = 8;  // frontal for quadrilaterals

Physical Surface("steel") = {1};
Physical Surface("bronze") = surfaces[];
Physical Curve("bolts") = inner[];
Physical Curve("bushes") = outer[];
Physical Curve("wall") = {8};
Physical Curve("fillet") = {3};
Physical Curve("top") = {6, 7};
Physical Curve("crack:arm") = {9};
Physical Point("load") = {6};
Physical Point("corner") = {5};
