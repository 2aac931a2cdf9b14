// A bracket bolted to a wall: two bolt holes with bronze bushes, a filleted arm, a crack in the top edge of the arm. Lengths in m.
// What the program that reads it needs are the physical groups at the end: materials, supports, the crack and named points.

h = 0.010;          // cells of the leg and of the arm
fine = 0.0035;      // cells along the crack
thick = 0.040;      // height of the arm, width of the leg
reach = 0.200;      // of the arm, from the wall
tall = 0.160;       // of the leg
round = 0.020;      // radius of the fillet
crack = 0.026;      // depth of the crack below the top edge
hole = 0.008;       // radius of the bolt holes
bush = 0.014;       // outer radius of the bushes

// outline, counter-clockwise from the lower left corner
Point(1) = {0, 0, 0, h};
Point(2) = {thick, 0, 0, h};
Point(3) = {thick, tall - thick - round, 0, h};
Point(4) = {thick + round, tall - thick, 0, h};
Point(5) = {reach, tall - thick, 0, h};
Point(6) = {reach, tall, 0, h};
Point(7) = {0.096, tall, 0, fine};                 // mouth of the crack
Point(8) = {0, tall, 0, h};
Point(9) = {thick + round, tall - thick - round, 0, h};  // centre of the fillet
Line(1) = {1, 2};
Line(2) = {2, 3};
Circle(3) = {3, 9, 4};
Line(4) = {4, 5};
Line(5) = {5, 6};
Line(6) = {6, 7};
Line(7) = {7, 8};
Line(8) = {8, 1};
Curve Loop(1) = {1:8};

// the crack leans by about 17 degrees: its tip is loaded in modes I and II
Point(10) = {0.088, tall - crack, 0, fine};
Line(9) = {7, 10};

// two bushes around the bolt holes: four arcs inside, four outside, a quarter of the ring between them
surfaces[] = {};
inner[] = {};
outer[] = {};
loops[] = {1};
For k In {0:1}
  x = 0.5 * thick;
  y = 0.030 + 0.060 * k;
  p = newp;
  Point(p) = {x, y, 0, h};
  For i In {0:3}
    Point(p + 1 + i) = {x + hole * Cos(i * Pi / 2), y + hole * Sin(i * Pi / 2), 0, h};
    Point(p + 5 + i) = {x + bush * Cos(i * Pi / 2), y + bush * Sin(i * Pi / 2), 0, h};
  EndFor
  c = newc;
  For i In {0:3}
    j = (i + 1) % 4;
    Circle(c + i) = {p + 1 + i, p, p + 1 + j};
    Circle(c + 4 + i) = {p + 5 + i, p, p + 5 + j};
    Line(c + 8 + i) = {p + 1 + i, p + 5 + i};
  EndFor
  loop = newcl;
  Curve Loop(loop) = {c + 4 : c + 7};
  loops[] += loop;
  inner[] += {c : c + 3};
  outer[] += {c + 4 : c + 7};
  Transfinite Curve{c : c + 7} = 3;
  Transfinite Curve{c + 8 : c + 11} = 2;
  For i In {0:3}
    s = news;
    quarter = newcl;
    Curve Loop(quarter) = {c + i, c + 8 + (i + 1) % 4, -(c + 4 + i), -(c + 8 + i)};
    Plane Surface(s) = {quarter};
    Transfinite Surface{s};
    surfaces[] += s;
  EndFor
EndFor

Plane Surface(1) = {loops[]};
Curve{9} In Surface{1};
Recombine Surface{1, surfaces[]};

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
